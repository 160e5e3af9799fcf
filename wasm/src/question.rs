//! Queries, and their dispatch.

use serde::Deserialize;
use serde_json::{Value, json};
use spinney_base::io::batch::{MissingRange, try_once};
use spinney_base::{Error, Result};
use spinney_brep::ExactModel;
use spinney_container::{Content as FileContent, FileHeader, FileReference};
use spinney_engine::dataset::Dataset;
use spinney_engine::ops::TreeFile;

use crate::answer::{Answer, Found};
use crate::files::{self, Content, File, Opened};
use crate::part::Part;
use crate::windows::Detail;
use crate::{failure, header, history, model, pictures, points, search, solid, statistics, windows, zones};

/// Members that every query has: its name, and its subject.
#[derive(Deserialize)]
struct About {
    ask: String,
    /// Number of the open object.
    of: Option<u32>,
}

/// The file to be opened, with layer and commit.
#[derive(Deserialize)]
struct Open {
    file: u64,
    commit: Option<u64>,
    layer: Option<String>,
}

/// Maximum number of commits.
#[derive(Deserialize)]
struct Commits {
    limit: Option<usize>,
}

/// The level at which points are read.
#[derive(Deserialize)]
struct Contains {
    level: Option<u8>,
}

/// The result of an attempt of a query.
enum Outcome {
    Found(Found),
    /// With its header.
    Opened(Opened, Value),
}

impl From<Found> for Outcome {
    fn from(found: Found) -> Outcome {
        Outcome::Found(found)
    }
}

/// Parses members of a query. (Each query has its own.)
fn members<'q, T: Deserialize<'q>>(question: &'q Value) -> Result<T> {
    let expected = "members of the types that `index.d.ts` tells";
    T::deserialize(question).map_err(|error| Error::invalid("question", error.to_string(), expected))
}

/// Tries a query once.
pub(crate) fn ask(text: &str, places: &[f64]) -> Answer {
    let mut outcome = None;
    let (result, missing) = try_once(&mut || {
        let question: Value = serde_json::from_str(text)
            .map_err(|error| Error::invalid("question", error.to_string(), "JSON"))?;
        outcome = Some(answer(&question, places)?);
        Ok(())
    });
    if !missing.is_empty() {
        let numbers = |missing: &MissingRange| {
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

fn answer(question: &Value, places: &[f64]) -> Result<Outcome> {
    let About { ask, of } = members(question)?;
    if ask == "open" {
        let Open { file, commit, layer } = members(question)?;
        let opened = open(files::file(file)?, commit, layer)?;
        let header = header::of(&opened)?;
        return Ok(Outcome::Opened(opened, header));
    }
    let opened = files::opened(of.unwrap_or_default())?;
    let opened = &*opened;
    let part = || members::<Part>(question);
    let detail = || members::<Detail>(question);
    let found = match &*ask {
        "window" => windows::window(opened.cells()?, (&part()?, &detail()?), &members(question)?)?,
        "points" => points::values(opened.cells()?, &members(question)?, places)?,
        "stats" => statistics::statistics(opened.cells()?, &part()?, &members(question)?)?,
        "histogram" => statistics::histogram(opened.cells()?, &part()?, &members(question)?)?,
        "zonal" => zones::zonal(opened, &members(question)?)?,
        "find" => search::find(opened.cells()?, &part()?, &members(question)?)?,
        "commits" => history::commits(opened, members::<Commits>(question)?.limit)?,
        "diff" => history::diff(opened, &part()?, &members(question)?)?,
        "image" => pictures::image(opened, (&part()?, &detail()?), &members(question)?)?,
        "tile" => pictures::tile(opened, &members(question)?)?,
        "legend" => pictures::legend(opened, &members(question)?)?,
        "contains" => match &opened.content {
            Content::Cells(tree) => solid::contains(tree, members::<Contains>(question)?.level, places)?,
            Content::Model(model) => model::contains(model, places)?,
        },
        "slice" => solid::slice(opened, (&part()?, &detail()?), &members(question)?)?,
        "geographic" => points::geographic(opened.cells()?, places)?,
        "mesh" => solid::mesh(opened.cells()?, &part()?, &members(question)?)?,
        "measures" => model::measures(opened.model()?)?,
        "section" => model::section(opened.model()?, &members(question)?)?,
        "triangles" => model::triangles(opened.model()?)?,
        // (For tests of panics.)
        "panic" => panic!("asked for"),
        other => return Err(Error::invalid("question", other, "one that the module knows")),
    };
    Ok(found.into())
}

fn open(file: File, commit: Option<u64>, layer: Option<String>) -> Result<Opened> {
    let options = file.options();
    let content = FileHeader::read(&file.name, &*options.open(&file.name)?)?.content;
    let content = if content == FileContent::Model {
        Content::Model(Box::new(ExactModel::open(&file.name, &options)?.into()))
    } else {
        let place = FileReference { file: file.name.as_path().into(), commit, layer };
        Content::Cells(Box::new(Dataset::of(TreeFile::at(&place, &options)?.into())?))
    };
    Ok(Opened::new(file, content))
}
