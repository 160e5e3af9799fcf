//! The one place that brings operands of an operation to the first: coordinate system, grid and extent, type, scale and unit, classes.
//!
//! Every operation on several files has its operands from here, so that all of them mean the same by the same number and the same cell.
//! What is converted is a line of a table ([`Conversion`]); what would be lost is an error that names the way out.

mod classes;
mod grid;
mod values;

use std::fmt;
use std::path::Path;

use super::affine::View;
use super::converted::{Converted, ValueMap};
use super::view_source::ViewSource;
use crate::query::source_statistics;
use crate::tree::Source;
use classes::{Classes, Renumbered};
use serde::{Deserialize, Serialize};
use spinney_base::value::{DataKind, Number, Rule, SampleType, Value, ValueType};
use spinney_base::{Error, Progress, Result};
use spinney_container::{Header, Metadata};

pub use classes::ClassMatching;
pub(super) use grid::{CommonGrid, Located, Position};
pub use grid::{OutputExtent, grid_like};
pub(super) use values::Scale;
use values::{ValueSpace, Valued};

/// Options for bringing operands to the first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ReconcileOptions {
    /// The part of the world that the result covers.
    pub extent: OutputExtent,
    /// How classes are matched.
    pub classes: ClassMatching,
    /// Takes numbers as they are stored, whatever their scales, offsets and units.
    pub units_by_number: bool,
    /// Rounds numbers that the first operand's type cannot hold, where that type is fixed.
    pub round: bool,
}

/// A line about what was converted of an operand.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Conversion {
    /// The operand's name: its path.
    pub operand: String,
    /// What was converted: `grid`, `type`, `scale`, `unit` or `classes`.
    pub what: &'static str,
    /// From what to what.
    pub text: String,
}

impl fmt::Display for Conversion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}: {}", self.operand, self.what, self.text)
    }
}

/// What an operation needs of an operand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Needs {
    /// Its values, as values of the result.
    Values,
    /// Its values by themselves, with classes numbered as the first's.
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
    /// The meaning of values.
    pub(super) description: Description,
    /// What was converted.
    pub(super) conversions: Vec<Conversion>,
}

impl Reconciled {
    /// Warns of operands that were resampled.
    pub(super) fn warn_resampled(&self, progress: &dyn Progress) {
        for conversion in self.conversions.iter().filter(|conversion| conversion.what == "grid") {
            progress.warn(Path::new(&conversion.operand), &conversion.text);
        }
    }
}

/// The meaning of a result's values.
#[derive(Clone, Debug, Default)]
pub(super) struct Description {
    /// The number of the operand whose header and metadata describe the values.
    pub(super) operand: usize,
    space: Option<ValueSpace>,
    classes: Option<Classes>,
    /// Whether categorical and continuous values are joined, so that all are continuous.
    is_continuous: bool,
}

impl Description {
    /// The header of the result, of that of the [operand](Description::operand).
    pub(super) fn header(&self, header: &Header) -> Header {
        let mut header = header.clone();
        if self.is_continuous {
            (header.kind, header.rule) = (DataKind::Continuous, Rule::Mean);
        }
        header
    }

    /// Writes into metadata of the [operand](Description::operand) what is new: names and colours of classes, scale, offset and units.
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

/// The first operand, as others are brought to it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Target {
    /// Whether its type stays as it is, as that of a file that is edited does.
    pub(super) is_fixed: bool,
    /// Where the second operand lies.
    pub(super) position: Position,
}

/// Brings operands to the first: its grid, and values of one meaning.
///
/// # Errors
/// If an operand cannot be brought there, or something would be lost.
pub(super) fn reconcile(
    operands: Vec<(String, View)>,
    needs: &dyn Fn(usize) -> Needs,
    options: &ReconcileOptions,
    Target { is_fixed, position }: Target,
) -> Result<Reconciled> {
    let Some((first_name, first)) = operands.first() else {
        return Err(Error::invalid("files", "none", "at least one"));
    };
    let dimension = first.form().dimension;
    for (name, view) in &operands {
        if view.form().dimension != dimension {
            let expected = format!("{}, as {first_name} is", dimension.tree_name());
            return Err(Error::invalid(name.clone(), view.form().dimension.tree_name(), expected));
        }
    }
    let located: Vec<Located<'_>> = operands.iter().map(|(name, view)| Located::of(name, view)).collect();
    let grid = CommonGrid::of(&located, dimension, options.extent, position)?;
    let mut conversions = Vec::new();
    let described_by = (0..operands.len()).find(|number| needs(*number) != Needs::Presence).unwrap_or(0);
    let (classes, renumbered) = match_classes(&operands, described_by, needs, options)?;
    let valued: Vec<usize> = (0..operands.len()).filter(|number| needs(*number) == Needs::Values).collect();
    let (space, mut maps) = common_values(&operands, &valued, &renumbered, options, is_fixed)?;
    let is_continuous = !is_fixed && mixes_kinds(&operands, &valued);
    let mut described = operands[described_by].1.source().metadata().clone();
    if let Some(space) = &space {
        space.describe(&mut described);
    }
    // Deeper than needed if a tree of the grid's cells is: what it has stored fits as it is.
    let on_cells = operands.iter().enumerate().filter(|(number, _)| grid.shift(*number).is_some());
    let deepest = on_cells.map(|(_, (_, view))| view.depth()).max().unwrap_or(0);
    let mut views = Vec::with_capacity(operands.len());
    if is_continuous {
        let text = "categorical and continuous values are joined as continuous ones, without names and colours of classes".into();
        conversions.push(Conversion { operand: operands[described_by].0.clone(), what: "kind", text });
    }
    for (number, (name, view)) in operands.into_iter().enumerate() {
        let mut say = |what, text| conversions.push(Conversion { operand: name.clone(), what, text });
        if let Some(text) = grid.resampled(number, &view) {
            say("grid", text);
        }
        let metadata = view.source().metadata();
        let from = view.form().value;
        let to = match (&space, needs(number)) {
            (Some(space), Needs::Values | Needs::Presence) => space.value,
            _ => wide_enough(from, &renumbered[number]),
        };
        let map = match (needs(number), maps[number].take()) {
            (Needs::Presence, _) => (from != to).then_some(ValueMap::Presence(Value::ZERO)),
            (_, _) if !renumbered[number].is_empty() => {
                say("classes", list(&renumbered[number], metadata));
                let numbers = renumbered[number].iter().map(|class| (class.from, class.to)).collect();
                Some(ValueMap::Classes(numbers))
            }
            (_, map) => map,
        };
        if let Some(ValueMap::Linear(map)) = &map {
            let is_new =
                |(channel, pair): (usize, &(f64, f64))| (*pair != (1.0, 0.0)).then_some((channel, *pair));
            if let Some((channel, (factor, summand))) = map.iter().enumerate().find_map(is_new) {
                let unit = |metadata: &Metadata| metadata.units.get(channel).cloned().unwrap_or_default();
                let (here, there) = (unit(&described), unit(metadata));
                let summand = if summand == 0.0 { String::new() } else { format!(", plus {summand}") };
                let units = if here == there || there.is_empty() {
                    String::new()
                } else {
                    format!(" ({there} to {here})")
                };
                let text = format!("numbers times {factor}{summand}{units}");
                say("scale", text);
            }
        }
        if from.without_mask() != to.without_mask() && needs(number) == Needs::Values {
            say("type", format!("{from} as {to}"));
        }
        let view = match map {
            Some(map) => {
                let mut own = metadata.clone();
                if needs(number) == Needs::Values {
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

/// Matches the classes of operands with those of the operand that describes the result; for each operand the classes that get another number.
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
    // (Numbers that cells have matter only where one may get another.)
    let present = |number: usize| if differs { present_numbers(&operands[number].1) } else { Ok(Vec::new()) };
    let mut classes = Classes::of(metadata(described_by), &present(described_by)?);
    for number in &with_classes[1..] {
        renumbered[*number] = classes.add(metadata(*number), &present(*number)?, options.classes);
    }
    Ok((Some(classes), renumbered))
}

/// Whether some operands of which values are needed are categorical, and others continuous.
fn mixes_kinds(operands: &[(String, View)], valued: &[usize]) -> bool {
    let mut kinds = valued.iter().map(|number| operands[*number].1.source().header().kind);
    let first = kinds.next();
    kinds.any(|kind| Some(kind) != first)
}

/// The numbers that cells of a view's source have.
fn present_numbers(view: &View) -> Result<Vec<Number>> {
    let source = view.source();
    let picture = source.header().picture();
    let statistics = match &**source {
        ViewSource::File(file) => file.statistics_with(&picture, true, &())?,
        source => source_statistics(source, &picture, true, &())?,
    };
    Ok(statistics.classes.into_iter().map(|(number, _)| number).collect())
}

/// The values of the result, and the way there of each operand whose values are needed.
#[allow(clippy::type_complexity)]
fn common_values(
    operands: &[(String, View)],
    valued: &[usize],
    renumbered: &[Vec<Renumbered>],
    options: &ReconcileOptions,
    is_fixed: bool,
) -> Result<(Option<ValueSpace>, Vec<Option<ValueMap>>)> {
    let mut maps: Vec<Option<ValueMap>> = operands.iter().map(|_| None).collect();
    let of = |number: &usize| {
        let (name, view) = &operands[*number];
        let classes_to = renumbered[*number].iter().map(|class| class.to.to_f64()).reduce(f64::max);
        Valued { name, view, classes_to }
    };
    let list: Vec<Valued<'_>> = valued.iter().map(of).collect();
    if list.is_empty() {
        return Ok((None, maps));
    }
    let (space, found) = values::common(&list, options, is_fixed)?;
    for (number, map) in valued.iter().zip(found) {
        maps[*number] = map;
    }
    Ok((Some(space), maps))
}

/// A type that holds the new numbers of classes.
fn wide_enough(value: ValueType, renumbered: &[Renumbered]) -> ValueType {
    let fits = |sample: SampleType| renumbered.iter().all(|class| sample.can_hold(class.to));
    let candidates = [value.sample, SampleType::U16, SampleType::I32, SampleType::I64, SampleType::U64];
    let sample = candidates.into_iter().find(|sample| fits(*sample)).unwrap_or(value.sample);
    ValueType { sample, ..value }
}

/// Classes that get other numbers, as text: at most ten.
fn list(renumbered: &[Renumbered], metadata: &Metadata) -> String {
    let show = |class: &Renumbered| {
        let name = metadata.class_names.get(&class.from).map_or(String::new(), |name| format!("{name} "));
        format!("{name}{} becomes {}", class.from, class.to)
    };
    let more =
        if renumbered.len() > 10 { format!(" and {} more", renumbered.len() - 10) } else { String::new() };
    format!("{}{more}", renumbered.iter().take(10).map(show).collect::<Vec<_>>().join(", "))
}
