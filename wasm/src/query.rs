//! Queries, and their dispatch.

use serde::Deserialize;
use serde_json::{Value, json};
use spinney_base::io::batch::{MissingRange, try_once};
use spinney_base::{Error, Result};
use spinney_brep::ExactModel;
use spinney_container::{Content as FileContent, FileHeader, FileReference};
use spinney_engine::dataset::Dataset;
use spinney_engine::ops::TreeFile;

use crate::files::{self, Content, File, Opened};
use crate::region::Region;
use crate::result::{Found, QueryResult};
use crate::windows::Detail;
use crate::{failure, header, history, images, model, points, search, solid, statistics, windows, zones};

/// Members that every query has: its name, and its subject.
#[derive(Deserialize)]
struct QueryHead {
    query: String,
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
fn members<'q, T: Deserialize<'q>>(request: &'q Value) -> Result<T> {
    let expected = "members as declared in `index.d.ts`";
    T::deserialize(request).map_err(|error| Error::invalid("query", error.to_string(), expected))
}

/// Tries a query once.
pub(crate) fn run(text: &str, coordinates: &[f64]) -> QueryResult {
    let mut outcome = None;
    let (result, missing) = try_once(&mut || {
        let request: Value =
            serde_json::from_str(text).map_err(|error| Error::invalid("query", error.to_string(), "JSON"))?;
        outcome = Some(dispatch(&request, coordinates)?);
        Ok(())
    });
    if !missing.is_empty() {
        let numbers = |missing: &MissingRange| {
            [missing.file.number() as f64, missing.range.start as f64, missing.range.end as f64]
        };
        return QueryResult::missing_ranges(missing.iter().flat_map(numbers).collect());
    }
    match (result, outcome) {
        (Err(error), _) => QueryResult::failed(&failure::as_json(&error)),
        (Ok(()), Some(Outcome::Found(found))) => found.into(),
        (Ok(()), Some(Outcome::Opened(opened, header))) => {
            Found::from(json!({ "opened": files::keep(opened), "header": header })).into()
        }
        (Ok(()), None) => Found::default().into(),
    }
}

fn dispatch(request: &Value, coordinates: &[f64]) -> Result<Outcome> {
    let QueryHead { query, of } = members(request)?;
    if query == "open" {
        let Open { file, commit, layer } = members(request)?;
        let opened = open(files::file(file)?, commit, layer)?;
        let header = header::of(&opened)?;
        return Ok(Outcome::Opened(opened, header));
    }
    let opened = files::opened(of.unwrap_or_default())?;
    let opened = &*opened;
    let region = || members::<Region>(request);
    let detail = || members::<Detail>(request);
    let found = match &*query {
        "window" => windows::window(opened.cells()?, (&region()?, &detail()?), &members(request)?)?,
        "points" => points::values(opened.cells()?, &members(request)?, coordinates)?,
        "stats" => statistics::statistics(opened.cells()?, &region()?, &members(request)?)?,
        "histogram" => statistics::histogram(opened.cells()?, &region()?, &members(request)?)?,
        "zonal" => zones::zonal(opened, &members(request)?)?,
        "find" => search::find(opened.cells()?, &region()?, &members(request)?)?,
        "commits" => history::commits(opened, members::<Commits>(request)?.limit)?,
        "diff" => history::diff(opened, &region()?, &members(request)?)?,
        "image" => images::image(opened, (&region()?, &detail()?), &members(request)?)?,
        "tile" => images::tile(opened, &members(request)?)?,
        "legend" => images::legend(opened, &members(request)?)?,
        "contains" => match &opened.content {
            Content::Cells(tree) => solid::contains(tree, members::<Contains>(request)?.level, coordinates)?,
            Content::Model(model) => model::contains(model, coordinates)?,
        },
        "slice" => solid::slice(opened, (&region()?, &detail()?), &members(request)?)?,
        "geographic" => points::geographic(opened.cells()?, coordinates)?,
        "mesh" => match &opened.content {
            Content::Cells(tree) => solid::mesh(tree, &region()?, &members(request)?)?,
            Content::Model(model) => model::mesh(model, &members(request)?)?,
        },
        "measures" => model::measures(opened.model()?)?,
        "section" => model::section(opened.model()?, &members(request)?)?,
        "cut" => model::cut(opened.model()?, members(request)?)?,
        "triangles" => model::triangles(opened.model()?)?,
        // (For tests of panics.)
        "panic" => panic!("requested by a test"),
        other => return Err(Error::invalid("query", other, "the name of one of the module's queries")),
    };
    Ok(found.into())
}

fn open(file: File, commit: Option<u64>, layer: Option<String>) -> Result<Opened> {
    let options = file.options();
    let content = FileHeader::read(&file.name, &*options.open(&file.name)?)?.content;
    let content = if content == FileContent::Model {
        Content::Model(Box::new(ExactModel::open(&file.name, &options)?.into()))
    } else {
        let reference = FileReference { file: file.name.as_path().into(), commit, layer };
        Content::Cells(Box::new(Dataset::of(TreeFile::at(&reference, &options)?.into())?))
    };
    Ok(Opened::new(file, content))
}
