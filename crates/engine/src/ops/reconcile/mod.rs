//! Converts the operands of an operation to the first one: coordinate system, grid and extent,
//! type, scale and unit, classes.
//!
//! Every operation on several files gets its operands from here, so that the same number and the
//! same cell mean the same in all of them. Conversions are reported as lines of a table
//! ([`Conversion`]). A conversion that would lose information is an error that names a solution.

mod classes;
mod grid;
mod values;

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use super::affine::View;
use super::converted::{Converted, ValueMap};
use super::view_source::ViewSource;
use crate::query::source_statistics;
use crate::tree::Source;
use classes::{Classes, Renumbered};
use serde::{Deserialize, Serialize};
use spinney_base::space::Dimension;
use spinney_base::value::{DataKind, Number, Rule, SampleType, Value, ValueType};
use spinney_base::{Error, Progress, Result};
use spinney_container::{Header, Metadata};

pub use classes::ClassMatching;
pub(super) use grid::{CommonGrid, Located, Position};
pub use grid::{OutputExtent, grid_like};
pub(super) use values::Scale;
use values::{ValueSpace, Valued};

/// Options for converting operands to the first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ReconcileOptions {
    /// Region of the world that the result covers.
    pub extent: OutputExtent,
    /// How classes are matched.
    pub classes: ClassMatching,
    /// Uses stored numbers, regardless of scales, offsets and units.
    pub units_by_number: bool,
    /// Rounds numbers that the first operand's type cannot hold, if that type is fixed.
    pub round: bool,
}

/// Report of one conversion of an operand.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Conversion {
    /// Name of the operand: its path.
    pub operand: String,
    /// Converted property: `grid`, `type`, `scale` (with the unit), `classes` or `kind`.
    pub what: &'static str,
    /// Description of the conversion: from what to what.
    pub text: String,
}

impl fmt::Display for Conversion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}: {}", self.operand, self.what, self.text)
    }
}

/// Need of an operation for an operand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Needs {
    /// Its values, converted to values of the result.
    Values,
    /// Its own values, with classes numbered as in the first operand.
    OwnValues,
    /// Which of its cells are present.
    Presence,
}

/// Operands on one grid, with values of one type and meaning.
pub(super) struct Reconciled {
    /// Views on the grid, in the operands' order; all of one depth.
    pub(super) views: Vec<View>,
    /// The grid.
    pub(super) grid: CommonGrid,
    /// Meaning of the values.
    pub(super) description: Description,
    /// Conversions, operand by operand.
    pub(super) conversions: Vec<Conversion>,
}

impl Reconciled {
    /// Warns about operands that were resampled.
    pub(super) fn warn_resampled(&self, progress: &dyn Progress) {
        for conversion in self.conversions.iter().filter(|conversion| conversion.what == "grid") {
            progress.warn(Path::new(&conversion.operand), &conversion.text);
        }
    }
}

/// Meaning of a result's values.
#[derive(Clone, Debug, Default)]
pub(super) struct Description {
    /// Index of the operand whose header and metadata describe the values.
    pub(super) operand: usize,
    space: Option<ValueSpace>,
    classes: Option<Classes>,
    /// Whether categorical and continuous values are combined, so that all are continuous.
    is_continuous: bool,
}

impl Description {
    /// Header of the result, from that of the [operand](Description::operand).
    pub(super) fn header(&self, header: &Header) -> Header {
        let mut header = header.clone();
        if self.is_continuous {
            (header.kind, header.rule) = (DataKind::Continuous, Rule::Mean);
        }
        header
    }

    /// Updates metadata of the [operand](Description::operand): names and colours of classes,
    /// scale, offset and units.
    pub(super) fn describe(&self, metadata: &mut Metadata) {
        if let Some(space) = &self.space {
            space.describe(metadata);
        }
        if let Some(classes) = &self.classes {
            metadata.class_names.clone_from(&classes.names);
            metadata.palette.clone_from(&classes.palette);
        }
        if self.is_continuous {
            metadata.class_names.clear();
            metadata.palette = None;
        }
    }
}

/// How operands are converted to the first one.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Target {
    /// Whether the first operand's type is fixed, as for a file that is edited.
    pub(super) is_fixed: bool,
    /// Position of the second operand.
    pub(super) position: Position,
}

/// Converts operands to the first one's grid, and to values of one meaning.
///
/// # Errors
/// If an operand cannot be converted, or information would be lost.
pub(super) fn reconcile(
    operands: Vec<(String, View)>,
    needs: &dyn Fn(usize) -> Needs,
    options: &ReconcileOptions,
    Target { is_fixed, position }: Target,
) -> Result<Reconciled> {
    let dimension = common_dimension(&operands)?;
    let located: Vec<Located<'_>> = operands.iter().map(|(name, view)| Located::of(name, view)).collect();
    let grid = CommonGrid::of(&located, dimension, options.extent, position)?;
    let mut conversions = Vec::new();
    let described_by = (0..operands.len()).find(|number| needs(*number) != Needs::Presence).unwrap_or(0);
    let (classes, renumbered) = match_classes(&operands, described_by, needs, options)?;
    let valued = |number: usize| Valued::of(number, &operands[number], &renumbered[number]);
    let valued: Vec<Valued<'_>> =
        (0..operands.len()).filter(|number| needs(*number) == Needs::Values).map(valued).collect();
    let (space, mut maps) = match &valued[..] {
        [] => (None, BTreeMap::new()),
        valued => {
            let (space, maps) = values::common(valued, options, is_fixed)?;
            (Some(space), maps)
        }
    };
    let is_continuous = !is_fixed && mixes_kinds(&valued);
    if is_continuous {
        let text = "categorical and continuous values are combined as continuous values, without class names and colours".into();
        conversions.push(Conversion { operand: operands[described_by].0.clone(), what: "kind", text });
    }
    let mut described = operands[described_by].1.source().metadata().clone();
    if let Some(space) = &space {
        space.describe(&mut described);
    }
    // Deeper than needed if a tree with the grid's cells is: its stored subtrees can then be
    // reused.
    let on_cells = operands.iter().enumerate().filter(|(number, _)| grid.shift(*number).is_some());
    let deepest = on_cells.map(|(_, (_, view))| view.depth()).max().unwrap_or(0);
    let mut views = Vec::with_capacity(operands.len());
    for (number, (name, view)) in operands.into_iter().enumerate() {
        let mut say = |what, text| conversions.push(Conversion { operand: name.clone(), what, text });
        if let Some(text) = grid.resampled(number, &view) {
            say("grid", text);
        }
        let (needs, classes) = (needs(number), &renumbered[number]);
        let metadata = view.source().metadata();
        let from = view.form().value;
        let to = match (&space, needs) {
            (Some(space), Needs::Values | Needs::Presence) => space.value,
            _ => wide_enough(from, classes),
        };
        let map = match needs {
            Needs::Presence => (from != to).then_some(ValueMap::Presence(Value::ZERO)),
            _ if !classes.is_empty() => {
                Some(ValueMap::Classes(classes.iter().map(|class| (class.from, class.to)).collect()))
            }
            _ => maps.remove(&number),
        };
        match &map {
            Some(ValueMap::Classes(_)) => say("classes", list(classes, metadata)),
            Some(ValueMap::Linear(maps)) => {
                if let Some(text) = scaled(maps, &metadata.units, &described.units) {
                    say("scale", text);
                }
            }
            _ => {}
        }
        if from.without_mask() != to.without_mask() && needs == Needs::Values {
            say("type", format!("{from} as {to}"));
        }
        let view = match map {
            Some(map) => {
                let mut own = metadata.clone();
                if needs == Needs::Values {
                    (own.scale_offset, own.units) = (described.scale_offset.clone(), described.units.clone());
                    own.alpha = described.alpha;
                }
                let converted = Converted::new(view.source().clone(), to, map, own);
                view.converted(converted)
            }
            None => view,
        };
        views.push(grid.bring(number, view)?);
    }
    let deepest = views.iter().map(View::depth).fold(deepest, u8::max);
    let views = views.into_iter().map(|view| view.deepened(deepest)).collect::<Result<_>>()?;
    let description = Description { operand: described_by, space, classes, is_continuous };
    Ok(Reconciled { views, grid, description, conversions })
}

/// Dimension of all operands, of which there must be at least one.
fn common_dimension(operands: &[(String, View)]) -> Result<Dimension> {
    let Some((first_name, first)) = operands.first() else {
        return Err(Error::invalid("files", "none", "at least one"));
    };
    let dimension = first.form().dimension;
    match operands.iter().find(|(_, view)| view.form().dimension != dimension) {
        None => Ok(dimension),
        Some((name, view)) => {
            let expected = format!("{}, like {first_name}", dimension.tree_name());
            Err(Error::invalid(name.clone(), view.form().dimension.tree_name(), expected))
        }
    }
}

/// Matches the classes of operands with those of the operand that describes the result. Returns,
/// for each operand, the classes that get another number.
fn match_classes(
    operands: &[(String, View)],
    described_by: usize,
    needs: &dyn Fn(usize) -> Needs,
    options: &ReconcileOptions,
) -> Result<(Option<Classes>, Vec<Vec<Renumbered>>)> {
    let mut renumbered: Vec<Vec<Renumbered>> = operands.iter().map(|_| Vec::new()).collect();
    let has_classes = |number: &usize| {
        let header = operands[*number].1.source().header();
        let is_one = header.kind == DataKind::Categorical && header.form.value.channels == 1;
        is_one && needs(*number) != Needs::Presence
    };
    let with_classes: Vec<usize> = (0..operands.len()).filter(has_classes).collect();
    if with_classes.len() < 2 || with_classes[0] != described_by {
        return Ok((None, renumbered));
    }
    let metadata = |number: usize| operands[number].1.source().metadata();
    let is_by_name = options.classes == ClassMatching::Name;
    let own = Classes::of(metadata(described_by), &[]);
    let differs = is_by_name && with_classes[1..].iter().any(|number| own.may_differ(metadata(*number)));
    // (The numbers of cells matter only if some may change.)
    let present = |number: usize| if differs { present_numbers(&operands[number].1) } else { Ok(Vec::new()) };
    let mut classes = Classes::of(metadata(described_by), &present(described_by)?);
    for number in &with_classes[1..] {
        renumbered[*number] = classes.add(metadata(*number), &present(*number)?, options.classes);
    }
    Ok((Some(classes), renumbered))
}

/// Whether some operands whose values are needed are categorical, and others continuous.
fn mixes_kinds(valued: &[Valued<'_>]) -> bool {
    let mut kinds = valued.iter().map(|operand| operand.view.source().header().kind);
    let first = kinds.next();
    kinds.any(|kind| Some(kind) != first)
}

/// Numbers of the cells in a view's source.
fn present_numbers(view: &View) -> Result<Vec<Number>> {
    let source = view.source();
    let extent = source.header().extent_bounds();
    let statistics = match &**source {
        ViewSource::File(file) => file.statistics_with(&extent, true, &())?,
        source => source_statistics(source, &extent, true, &())?,
    };
    Ok(statistics.classes.into_iter().map(|(number, _)| number).collect())
}

/// Type that holds the new numbers of classes.
fn wide_enough(value: ValueType, renumbered: &[Renumbered]) -> ValueType {
    let fits = |sample: SampleType| renumbered.iter().all(|class| sample.can_hold(class.to));
    let candidates = [value.sample, SampleType::U16, SampleType::I32, SampleType::I64, SampleType::U64];
    let sample = candidates.into_iter().find(|sample| fits(*sample)).unwrap_or(value.sample);
    ValueType { sample, ..value }
}

/// Describes the map of the first channel whose numbers change, with the units on both sides if
/// they differ.
fn scaled(maps: &[(f64, f64)], from: &[String], to: &[String]) -> Option<String> {
    let channel = maps.iter().position(|map| *map != (1.0, 0.0))?;
    let (factor, summand) = maps[channel];
    let summand = if summand == 0.0 { String::new() } else { format!(", plus {summand}") };
    let unit = |units: &[String]| units.get(channel).cloned().unwrap_or_default();
    let (from, to) = (unit(from), unit(to));
    let units = if from == to || from.is_empty() { String::new() } else { format!(" ({from} to {to})") };
    Some(format!("numbers times {factor}{summand}{units}"))
}

/// Lists classes that get other numbers: at most ten.
fn list(renumbered: &[Renumbered], metadata: &Metadata) -> String {
    let show = |class: &Renumbered| {
        let name = metadata.class_names.get(&class.from).map_or(String::new(), |name| format!("{name} "));
        format!("{name}{} becomes {}", class.from, class.to)
    };
    let more =
        if renumbered.len() > 10 { format!(" and {} more", renumbered.len() - 10) } else { String::new() };
    format!("{}{more}", renumbered.iter().take(10).map(show).collect::<Vec<_>>().join(", "))
}
