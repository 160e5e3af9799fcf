//! Table of labels: size, box and neighbours of each, for labels that are values of cells or
//! components.

use std::path::{Path, PathBuf};

use super::border::ComponentSpan;
use super::connectivity::Connectivity;
use super::labels::Labels;
use super::rows::{Row, Rows, SortedRows};
use super::sweep::{Cells, Content, Sweeper, Unit};
use crate::ops::affine::View;
use crate::tree::Source;
use spinney_base::sort::float_key;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::{Number, Numbers, SampleType, Value, ValueType};
use spinney_base::{Error, Progress, Result, SubProgress};
use zerocopy::{FromBytes, Immutable, IntoBytes};

/// Progress units of a pass over all cells.
const PASS: u64 = 1 << 32;

/// Request for the labels of a tree.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct LabelRequest {
    /// Connectivity of components: a label is then a connected component of cells of equal value,
    /// numbered from 1 as by `components=`. If `None`, all cells of equal value have that value as
    /// label.
    pub connect: Option<Connectivity>,
    /// Whether neighbours are requested.
    pub neighbours: bool,
    /// Approximate memory limit in bytes.
    pub memory: u64,
    /// Directory for temporary files, in case labels exceed the memory limit; by default the
    /// system's.
    pub directory: Option<PathBuf>,
}

impl LabelRequest {
    /// Request for the values of cells as labels, with neighbours, with 64 MiB of memory.
    pub fn new() -> LabelRequest {
        LabelRequest { connect: None, neighbours: true, memory: 64 << 20, directory: None }
    }
}

impl Default for LabelRequest {
    fn default() -> LabelRequest {
        LabelRequest::new()
    }
}

/// Counts of labels, and of their cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct LabelSummary {
    /// Number of labels.
    pub count: u64,
    /// Number of cells that have them.
    pub cells: u64,
}

/// Label that is adjacent to another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct LabelNeighbour {
    /// The label.
    pub label: Number,
    /// Number of cell edges that the two share; faces, in octrees.
    pub faces: u64,
}

/// Label with a description of its cells.
pub struct Label<'a> {
    row: LabelRow,
    first: [u64; 3],
    names: Names,
    value: Option<ValueType>,
    touches: &'a mut SortedRows<TouchRow>,
}

impl Label<'_> {
    /// The label.
    pub fn label(&self) -> Number {
        self.names.number(self.row.label)
    }

    /// Value of all cells of a component, if components are counted. Not available for solids,
    /// whose components consist of cells that are at least half full.
    pub fn class(&self) -> Option<Numbers> {
        self.value.map(|value| value.numbers(self.row.value()))
    }

    /// Number of its cells.
    pub fn cells(&self) -> u64 {
        self.row.cells
    }

    /// Bounding box of its cells.
    pub fn bounds(&self) -> Bounds {
        Bounds { min: self.row.min.map(u64::from), max: self.row.max.map(u64::from) }
    }

    /// First of its cells in FD order.
    pub fn first_cell(&self) -> [u64; 3] {
        self.first
    }

    /// Next of the labels, in order, with which it shares edges (in octrees faces) of cells.
    ///
    /// # Errors
    /// If a temporary file cannot be read.
    pub fn next_neighbour(&mut self) -> Result<Option<LabelNeighbour>> {
        let is_own = |key: u128| (key >> 64) as u64 == self.row.label;
        if !self.touches.peek().is_some_and(is_own) {
            return Ok(None);
        }
        let touch = self.touches.next()?;
        Ok(touch.map(|touch| LabelNeighbour { label: self.names.number(touch.other), faces: touch.faces }))
    }
}

/// Receives labels in order.
pub type LabelVisitor<'a> = dyn FnMut(&mut Label<'_>) -> Result<()> + 'a;

/// How label numbers map to sort keys.
#[derive(Clone, Copy)]
enum Names {
    Unsigned,
    Signed,
    Float,
}

impl Names {
    fn of(sample: SampleType) -> Names {
        match sample {
            SampleType::U8 | SampleType::U16 | SampleType::U32 | SampleType::U64 => Names::Unsigned,
            SampleType::I8 | SampleType::I16 | SampleType::I32 | SampleType::I64 => Names::Signed,
            SampleType::F32 | SampleType::F64 => Names::Float,
        }
    }

    fn key(self, number: Number) -> u64 {
        match (self, number) {
            (Names::Unsigned, Number::Unsigned(number)) => number,
            (Names::Signed, Number::Unsigned(number)) => number | 1 << 63,
            (Names::Signed, Number::Signed(number)) => number as u64 ^ 1 << 63,
            // (Only for floating-point samples.)
            (_, number) => float_key(number.to_f64()),
        }
    }

    fn number(self, key: u64) -> Number {
        match self {
            Names::Unsigned => Number::Unsigned(key),
            Names::Signed if key >> 63 == 1 => Number::Unsigned(key & !(1 << 63)),
            Names::Signed => Number::Signed((key ^ 1 << 63) as i64),
            Names::Float => {
                let bits = key ^ if key >> 63 == 1 { 1 << 63 } else { u64::MAX };
                Number::Float(f64::from_bits(bits))
            }
        }
    }
}

/// Cells of a label, in one block or in all of them.
#[derive(Clone, Copy, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
struct LabelRow {
    label: u64,
    cells: u64,
    /// Index of the first cell in Z order.
    first: u64,
    min: [u32; 3],
    max: [u32; 3],
    value: [u8; 16],
}

impl LabelRow {
    fn value(&self) -> Value {
        Value::from_bytes(&self.value)
    }
}

impl Row for LabelRow {
    fn key(&self) -> u128 {
        self.label.into()
    }

    fn add(&mut self, other: &LabelRow) {
        self.cells += other.cells;
        self.first = self.first.min(other.first);
        for axis in 0..3 {
            self.min[axis] = self.min[axis].min(other.min[axis]);
            self.max[axis] = self.max[axis].max(other.max[axis]);
        }
    }
}

/// Number of cell faces that a label shares with another.
#[derive(Clone, Copy, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
struct TouchRow {
    label: u64,
    other: u64,
    faces: u64,
}

impl Row for TouchRow {
    fn key(&self) -> u128 {
        u128::from(self.label) << 64 | u128::from(self.other)
    }

    fn add(&mut self, other: &TouchRow) {
        self.faces += other.faces;
    }
}

/// Collects rows of labels, block by block.
struct Collector<'a> {
    cells: &'a Cells,
    names: Names,
    /// Labels of components, if these are counted.
    labels: Option<&'a Labels>,
    rows: Rows<LabelRow>,
    with_touches: bool,
    touches: Rows<TouchRow>,
}

impl Collector<'_> {
    fn name(&self, value: Value) -> u64 {
        self.names.key(self.cells.form().value.first_number(value))
    }

    fn touch(&mut self, a: u64, b: u64, faces: u64) -> Result<()> {
        if a == b || faces == 0 || !self.with_touches {
            return Ok(());
        }
        self.touches.push(TouchRow { label: a, other: b, faces })?;
        self.touches.push(TouchRow { label: b, other: a, faces })
    }
}

impl Sweeper for Collector<'_> {
    fn take(&mut self, unit: &Unit<'_>) -> Result<Vec<u64>> {
        let depth = self.cells.view.depth();
        let levels = depth - unit.code.level();
        let dimension = unit.code.dimension();
        let Bounds { min, max } = unit.code.bounds(depth);
        let first = unit.code.path() * dimension.cells(levels);
        match unit.content {
            Content::Uniform(value) => {
                let label = match self.labels {
                    Some(labels) => labels.of_uniform(labels.units.number_of(unit.code)),
                    None => self.name(value),
                };
                let [min, max] = [min, max].map(|corner| corner.map(|cell| cell as u32));
                let cells = dimension.cells(levels);
                self.rows.push(LabelRow { label, cells, first, min, max, value: value.to_bytes() })?;
                Ok(vec![label])
            }
            Content::Block(local, pairs) => {
                let ids = match self.labels {
                    Some(labels) => {
                        let at_border = local.components.iter().map(|component| component.is_at_border);
                        labels.of_block(labels.units.number_of(unit.code), at_border)?
                    }
                    None => local.components.iter().map(|component| self.name(component.value)).collect(),
                };
                let at = min.map(|cell| cell as u32);
                for ((label, component), own) in ids.iter().zip(&local.components).zip(local.boxes()) {
                    let [min, max] = own.map(|corner| std::array::from_fn(|axis| corner[axis] + at[axis]));
                    let (cells, first) = (component.cells, first + component.first);
                    let value = component.value.to_bytes();
                    self.rows.push(LabelRow { label: *label, cells, first, min, max, value })?;
                }
                for pair in pairs {
                    let [a, b] = pair.components.map(|component| ids[component as usize]);
                    self.touch(a, b, pair.faces)?;
                }
                Ok(ids)
            }
        }
    }

    fn meet(&mut self, a: &ComponentSpan, b: &ComponentSpan, faces: u64) -> Result<()> {
        self.touch(a.id, b.id, faces)
    }
}

/// Finds the labels of a view's cells, and passes them to `each` in order.
///
/// # Errors
/// If labels are values and these have several channels, the connectivity does not exist for this
/// dimension, the tree is corrupt, a temporary file or `each` fails, or on cancellation.
pub(crate) fn find_labels(
    view: &View,
    request: &LabelRequest,
    progress: &dyn Progress,
    each: &mut LabelVisitor<'_>,
) -> Result<LabelSummary> {
    let form = view.form();
    let cells = match request.connect {
        Some(connect) => Cells::bodies(view.clone(), connect.reach(form.dimension)?),
        None if form.value.channels == 1 => Cells::values(view.clone(), 0),
        None => {
            let advice = "a label is a single number: label components of equal cells instead, with 4 neighbours (6 in octrees)";
            return Err(Error::unsupported(view.source().name(), "labels of several channels", advice));
        }
    };
    table_of(&cells, request, progress, each)
}

/// Passes the labels of `cells` to `each`, as [`find_labels`] does for a view.
pub(super) fn table_of(
    cells: &Cells,
    request: &LabelRequest,
    progress: &dyn Progress,
    each: &mut LabelVisitor<'_>,
) -> Result<LabelSummary> {
    let directory = request.directory.clone().unwrap_or_else(std::env::temp_dir);
    let directory: &Path = &directory;
    let passes = 1 + u64::from(request.connect.is_some());
    let part = || SubProgress::new(progress, PASS, passes * PASS);
    let labels = match request.connect {
        Some(_) => Some(Labels::of(cells, 0, (directory, request.memory), &part())?),
        None => None,
    };
    let names = match labels {
        Some(_) => Names::Unsigned,
        None => Names::of(cells.form().value.sample),
    };
    let mut collector = Collector {
        cells,
        names,
        labels: labels.as_ref(),
        rows: Rows::new(directory, request.memory / 4),
        with_touches: request.neighbours,
        touches: Rows::new(directory, request.memory / 4),
    };
    cells.sweep(request.neighbours, request.memory / 4, &mut collector, &part())?;
    let Collector { rows, touches, .. } = collector;
    let (mut rows, mut touches) = (rows.sorted()?, touches.sorted()?);
    let mut summary = LabelSummary::default();
    let (form, depth) = (cells.form(), cells.view.depth());
    let value = (labels.is_some() && cells.filling.is_none()).then_some(form.value);
    while let Some(row) = rows.next()? {
        if summary.count.is_multiple_of(1 << 12) {
            progress.check()?;
        }
        summary.count += 1;
        summary.cells += row.cells;
        let first = Code::from_path(form.dimension, depth, row.first).map_or([0; 3], Code::cell);
        let first = first.map(u64::from);
        let mut label = Label { row, first, names, value, touches: &mut touches };
        each(&mut label)?;
        while label.next_neighbour()?.is_some() {}
    }
    Ok(summary)
}
