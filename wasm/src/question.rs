//! Questions: what can be asked, and who answers.

use serde::Deserialize;
use serde_json::json;
use spinney_base::io::rounds::attempt;
use spinney_base::{Error, Result};
use spinney_brep::ExactModel;
use spinney_container::{Content as FileContent, FileHeader, FilePlace};
use spinney_engine::dataset::Dataset;
use spinney_engine::ops::TreeFile;

use crate::answer::{Answer, Found};
use crate::files::{self, Content, File, Opened};
use crate::{failure, header, history, model, pictures, points, search, solid, statistics, windows, zones};

/// A question about a file, or about what is open of it (`of`).
#[derive(Deserialize)]
#[serde(tag = "ask", rename_all = "camelCase")]
enum Question {
    Open {
        file: u64,
        commit: Option<u64>,
        layer: Option<String>,
    },
    Layer {
        of: u32,
        name: String,
    },
    Window {
        of: u32,
        #[serde(flatten)]
        window: windows::Window,
    },
    Points {
        of: u32,
        #[serde(flatten)]
        request: points::Request,
    },
    Stats {
        of: u32,
        #[serde(flatten)]
        request: statistics::Request,
    },
    Histogram {
        of: u32,
        #[serde(flatten)]
        request: statistics::HistogramRequest,
    },
    Zonal {
        of: u32,
        #[serde(flatten)]
        request: zones::Request,
    },
    Find {
        of: u32,
        #[serde(flatten)]
        request: search::Request,
    },
    Commits {
        of: u32,
        limit: Option<usize>,
    },
    Diff {
        of: u32,
        #[serde(flatten)]
        request: history::Request,
    },
    Contains {
        of: u32,
        level: Option<u8>,
    },
    Slice {
        of: u32,
        #[serde(flatten)]
        slice: solid::Slice,
    },
    SliceImage {
        of: u32,
        #[serde(flatten)]
        slice: solid::Slice,
        style: Option<String>,
    },
    /// Of places in the file's own system, which stand beside.
    Geographic {
        of: u32,
    },
    Mesh {
        of: u32,
        #[serde(flatten)]
        request: solid::MeshRequest,
    },
    Measures {
        of: u32,
    },
    Section {
        of: u32,
        #[serde(flatten)]
        plane: model::Plane,
    },
    Triangles {
        of: u32,
    },
    Image {
        of: u32,
        #[serde(flatten)]
        image: pictures::Image,
    },
    Tile {
        of: u32,
        #[serde(flatten)]
        tile: pictures::Tile,
    },
    Legend {
        of: u32,
        style: Option<String>,
    },
    /// Panics, for tests of what comes of that.
    Panic {
        message: String,
    },
}

/// What a pass over a question leads to.
enum Outcome {
    Found(Found),
    /// With its header.
    Opened(Opened, serde_json::Value),
}

impl From<Found> for Outcome {
    fn from(found: Found) -> Outcome {
        Outcome::Found(found)
    }
}

pub(crate) fn ask(text: &str, places: &[f64]) -> Answer {
    let question: Question = match serde_json::from_str(text) {
        Ok(question) => question,
        Err(error) => {
            let error = Error::invalid("question", error.to_string(), "one that the module knows");
            return Answer::failed(&failure::as_json(&error));
        }
    };
    let mut outcome = None;
    let (result, missing) = attempt(&mut || {
        outcome = Some(answer(&question, places)?);
        Ok(())
    });
    if !missing.is_empty() {
        let numbers = |missing: &spinney_base::io::rounds::MissingRange| {
            [missing.file.number() as f64, missing.range.start as f64, missing.range.end as f64]
        };
        return Answer::missing_ranges(missing.iter().flat_map(numbers).collect());
    }
    match (result, outcome) {
        (Err(error), _) => Answer::failed(&failure::as_json(&error)),
        (Ok(()), Some(Outcome::Found(found))) => found.into(),
        (Ok(()), Some(Outcome::Opened(opened, header))) => {
            Found::from(json!({ "opened": files::keep(opened), "header": header })).into()
        }
        (Ok(()), None) => Found::default().into(),
    }
}

fn answer(question: &Question, places: &[f64]) -> Result<Outcome> {
    let cells = |of: &u32| files::opened(*of);
    Ok(match question {
        Question::Open { file, commit, layer } => with_header(open(files::file(*file)?, *commit, layer)?)?,
        Question::Layer { of, name } => {
            let opened = cells(of)?;
            let tree = opened.cells()?.layer(name)?;
            with_header(Opened::new(opened.file.clone(), Content::Cells(Box::new(tree))))?
        }
        Question::Window { of, window } => windows::window(cells(of)?.cells()?, window)?.into(),
        Question::Points { of, request } => points::values(cells(of)?.cells()?, request, places)?.into(),
        Question::Stats { of, request } => statistics::statistics(cells(of)?.cells()?, request)?.into(),
        Question::Histogram { of, request } => statistics::histogram(cells(of)?.cells()?, request)?.into(),
        Question::Zonal { of, request } => zones::zonal(&*cells(of)?, request)?.into(),
        Question::Find { of, request } => search::find(cells(of)?.cells()?, request)?.into(),
        Question::Commits { of, limit } => history::commits(&cells(of)?.file, *limit)?.into(),
        Question::Diff { of, request } => history::diff(&*cells(of)?, request)?.into(),
        Question::Contains { of, level } => {
            let opened = cells(of)?;
            match &opened.content {
                Content::Cells(tree) => solid::contains(tree, *level, places)?.into(),
                Content::Model(model) => model::contains(model, places)?.into(),
            }
        }
        Question::Slice { of, slice } => solid::slice(cells(of)?.cells()?, slice)?.into(),
        Question::SliceImage { of, slice, style } => {
            let opened = cells(of)?;
            pictures::slice_image(opened.cells()?, &opened.prepared, slice, style.as_ref())?.into()
        }
        Question::Geographic { of } => points::geographic(cells(of)?.cells()?, places)?.into(),
        Question::Mesh { of, request } => solid::mesh(cells(of)?.cells()?, request)?.into(),
        Question::Measures { of } => model::measures(cells(of)?.model()?)?.into(),
        Question::Section { of, plane } => model::section(cells(of)?.model()?, plane)?.into(),
        Question::Triangles { of } => model::triangles(cells(of)?.model()?)?.into(),
        Question::Image { of, image } => {
            let opened = cells(of)?;
            pictures::image(opened.cells()?, &opened.prepared, image)?.into()
        }
        Question::Tile { of, tile } => {
            let opened = cells(of)?;
            pictures::tile(opened.cells()?, &opened.prepared, tile)?.into()
        }
        Question::Legend { of, style } => {
            let opened = cells(of)?;
            pictures::legend(opened.cells()?, &opened.prepared, style.as_ref())?.into()
        }
        Question::Panic { message } => panic!("{message}"),
    })
}

fn with_header(opened: Opened) -> Result<Outcome> {
    let header = header::of(&opened)?;
    Ok(Outcome::Opened(opened, header))
}

fn open(file: File, commit: Option<u64>, layer: &Option<String>) -> Result<Opened> {
    let options = file.options();
    let content = FileHeader::read(&file.name, &*options.open(&file.name)?)?.content;
    let content = if content == FileContent::Model {
        Content::Model(Box::new(ExactModel::open(&file.name, &options)?.into()))
    } else {
        let place = FilePlace { file: file.name.as_path().into(), commit, layer: layer.clone() };
        Content::Cells(Box::new(Dataset::of(TreeFile::at(&place, &options)?.into())?))
    };
    Ok(Opened::new(file, content))
}
