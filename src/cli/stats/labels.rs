//! `spinney stats --labels`: a table of labels, or of components.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result, bail, ensure};
use serde_json::json;
use spinney::raw::ops::Connectivity;
use spinney::raw::query::{Label, LabelRequest};
use spinney::raw::report::{CellMeasure, class_as_json, class_name, measure_key, printable_json};
use spinney::{Dataset, Number, Output};

use super::super::args::check_output;
use super::super::report::{Work, print_text, report_output};
use super::super::{Global, open};
use super::{Args, row_of};

/// Options for tables of labels.
#[derive(clap::Args)]
pub(super) struct LabelOptions {
    /// A row for each label (value of cells): number of cells, bounding box, and adjacent labels
    #[arg(long, group = "table")]
    #[arg(conflicts_with_all = ["window", "solid", "surface", "level"])]
    pub(super) labels: bool,
    /// Neighbours of a cell in its region: 4 or 8, in octrees 6 or 26; the values of cells are then
    /// classes, and labels number their components, as `transform components=` does
    #[arg(long, value_name = "N", requires = "labels")]
    connect: Option<Connectivity>,
    /// Classes of labels, from a tree of the same cells, such as that whose components were
    /// labelled
    #[arg(long, value_name = "FILE", requires = "labels", conflicts_with = "connect")]
    classes: Option<PathBuf>,
    /// File to write: for labels a table (.csv, .json); for zones their features, and for --nearest
    /// the points, with the results as attributes (.gpkg, .fgb, .geojson, .shp, .csv) [default:
    /// standard output]
    #[arg(short = 'o', long, value_name = "FILE", requires = "table")]
    pub(super) output: Option<PathBuf>,
}

/// Maximum size of buffered text, in bytes.
const MAX_TEXT: usize = 1 << 20;

/// Writes the table of a tree.
pub(super) fn run(args: &Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    let options = &args.label_options;
    let tree = args.tree.open(global)?;
    let is_json = match &options.output {
        _ if args.json => true,
        Some(path) => match path.extension().and_then(|extension| extension.to_str()) {
            Some("json") => true,
            Some("csv") => false,
            _ if path.as_path() == Path::new("-") || args.csv => false,
            _ => bail!("{}: unknown format; use .csv or .json, or --csv or --json", path.display()),
        },
        None => false,
    };
    let classes = options.classes.as_deref().map(|path| classes_of(path, &tree, global)).transpose()?;
    if let Some(path) = &options.output {
        check_output([&args.tree.file].into_iter().chain(&options.classes).map(PathBuf::as_path), path)?;
    }
    let mut request = LabelRequest::new();
    request.connect = options.connect;
    request.memory = args.zone_options.memory.bytes;
    let work = Work::start(global, "cells")?;
    let output = options.output.as_deref().map(|path| global.access().create(path)).transpose()?;
    // (Temporary files are in the directory of the table.)
    request.directory = options.output.as_deref().and_then(Path::parent).map(|directory| match directory {
        none if none == Path::new("") => ".".into(),
        directory => directory.to_path_buf(),
    });
    let mut table =
        Table { tree: &tree, classes: classes.as_ref(), is_json, count: 0, text: String::new(), output };
    table.begin();
    let mut failure = None;
    let walked = tree.labels(&request, &work, &mut |label| {
        table.add(label).map_err(|error| match error.downcast() {
            Ok(error) => error,
            Err(error) => {
                failure = Some(error);
                spinney::Error::Interrupted
            }
        })
    });
    failure.map_or(Ok(()), Err)?;
    let found = walked?;
    drop(work);
    table.finish()?;
    global.report("labels", format_args!("{} of {} cells", found.count, found.cells));
    if let Some(path) = &options.output {
        report_output(global, path, start);
    }
    Ok(())
}

/// Opens the tree with the labels' classes. Its cells must be those of the labels.
fn classes_of(path: &Path, labels: &Dataset, global: &Global) -> Result<Dataset> {
    let classes = open(path, global.access())?;
    let [own, other] = [labels, &classes].map(|tree| (tree.header().extent, tree.depth()));
    ensure!(
        Dataset::same_cells(&[labels, &classes]) == [0, 0],
        "{}: has other cells than the labels: {:?} in {} levels, expected {:?} in {} at the same position; align it with like= of `spinney transform`",
        path.display(),
        other.0,
        other.1,
        own.0,
        own.1
    );
    Ok(classes)
}

/// A table that is being written, to a file or to standard output.
struct Table<'a> {
    tree: &'a Dataset,
    classes: Option<&'a Dataset>,
    is_json: bool,
    count: u64,
    text: String,
    output: Option<Output>,
}

impl Table<'_> {
    fn axes(&self) -> usize {
        self.tree.header().form.axes()
    }

    fn begin(&mut self) {
        if self.is_json {
            self.text.push_str("{\n  \"labels\": [");
            return;
        }
        let axes = &["x", "y", "z"][..self.axes()];
        let each = |name: &'static str| axes.iter().map(move |axis| format!("{name}_{axis}"));
        let first = ["label", "class", "name", "cells", self.measure()].map(String::from);
        let boxes = each("min").chain(each("size")).chain(each("world_min")).chain(each("world_max"));
        let columns: Vec<String> = first.into_iter().chain(boxes).chain(["neighbours".into()]).collect();
        let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
        self.text.push_str(&row_of(&columns));
    }

    /// Returns the name of the measure: area in quadtrees, volume in octrees.
    fn measure(&self) -> &'static str {
        measure_key(self.tree)
    }

    /// Returns the area of cells in square metres, if known; in octrees the volume in the model's
    /// unit.
    fn measured(&self, cells: u64) -> Option<f64> {
        CellMeasure::of(self.tree).ok().map(|measure| measure.of_cell * cells as f64)
    }

    /// Returns the class of a label, and its name.
    fn class(&self, label: &Label<'_>) -> Result<(Vec<Number>, Option<String>)> {
        let (class, tree) = match self.classes {
            None => (label.class().map(|class| class.to_vec()), self.tree),
            Some(classes) => {
                let mut value = [Number::NAN; 4];
                let there = classes.point(label.first_cell(), classes.depth(), &mut value)?;
                let channels = usize::from(classes.header().form.value.channels);
                (there.then(|| value[..channels].to_vec()), classes)
            }
        };
        let named = match &class {
            Some(class) => class.first().copied(),
            None if self.classes.is_none() => Some(label.label()),
            None => None,
        };
        let name = named.and_then(|named| class_name(tree, named)).map(String::from);
        Ok((class.unwrap_or_default(), name))
    }

    fn add(&mut self, label: &mut Label<'_>) -> Result<()> {
        let (class, name) = self.class(label)?;
        let (bounds, measured) = (label.bounds(), self.measured(label.cells()));
        let world = self.tree.metadata().frame.world_box(&bounds);
        let axes = self.axes();
        self.count += 1;
        if self.is_json {
            let class = match &class[..] {
                [] => None,
                [one] => Some(class_as_json(*one)),
                several => Some(several.iter().copied().map(class_as_json).collect()),
            };
            let mut members = json!({
                "label": class_as_json(label.label()),
                "class": class,
                "name": name,
                "cells": label.cells(),
                "min": bounds.min[..axes],
                "size": bounds.size()[..axes],
                "world": world.map(|corner| corner[..axes].to_vec()),
            });
            members[self.measure()] = json!(measured);
            let members = members.to_string();
            let separator = if self.count > 1 { "," } else { "" };
            let open = members.strip_suffix('}').unwrap_or(&members);
            write!(self.text, "{separator}\n    {open},\"neighbours\":[")?;
        } else {
            let list = |numbers: Vec<String>| numbers.join(" ");
            let first = [
                label.label().to_string(),
                list(class.iter().map(Number::to_string).collect()),
                name.unwrap_or_default(),
                label.cells().to_string(),
                measured.map(|measured| measured.to_string()).unwrap_or_default(),
            ];
            let cells = bounds.min[..axes]
                .iter()
                .chain(&bounds.size()[..axes])
                .map(u64::to_string)
                .collect::<Vec<_>>();
            let world = world.iter().flat_map(|corner| corner[..axes].iter().map(f64::to_string));
            let fields: Vec<String> = first.into_iter().chain(cells).chain(world).collect();
            let fields: Vec<&str> = fields.iter().map(String::as_str).collect();
            let row = row_of(&fields);
            self.text.push_str(row.trim_end());
            self.text.push(',');
        }
        let mut is_first = true;
        while let Some(neighbour) = label.next_neighbour()? {
            let (label, faces) = (neighbour.label, neighbour.faces);
            let is_next = !std::mem::take(&mut is_first);
            if self.is_json {
                let separator = if is_next { "," } else { "" };
                write!(self.text, "{separator}{{\"label\":{},\"faces\":{faces}}}", class_as_json(label))?;
            } else {
                let separator = if is_next { " " } else { "" };
                write!(self.text, "{separator}{label}:{faces}")?;
            }
            self.write_some()?;
        }
        self.text.push_str(if self.is_json { "]}" } else { "\n" });
        self.write_some()
    }

    fn write_some(&mut self) -> Result<()> {
        if self.text.len() < MAX_TEXT { Ok(()) } else { self.write() }
    }

    fn write(&mut self) -> Result<()> {
        match &mut self.output {
            Some(output) => {
                let path = output.path().to_path_buf();
                output
                    .write_all(self.text.as_bytes())
                    .with_context(|| format!("{}: cannot write", path.display()))?;
            }
            None if self.is_json => print_text(&printable_json(&self.text))?,
            None => print_text(&self.text)?,
        }
        self.text.clear();
        Ok(())
    }

    fn finish(mut self) -> Result<()> {
        if self.is_json {
            self.text.push_str(if self.count > 0 { "\n  ]\n}\n" } else { "]\n}\n" });
        }
        self.write()?;
        Ok(self.output.map_or(Ok(()), Output::commit)?)
    }
}
