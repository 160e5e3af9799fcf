//! Common value space of operands: one type, scale and unit for all.

use std::collections::BTreeMap;

use super::ReconcileOptions;
use super::classes::Renumbered;
use crate::ops::affine::View;
use crate::ops::converted::ValueMap;
use crate::tree::Source;
use spinney_base::value::{Mask, Number, SampleType, ValueType};
use spinney_base::{Error, Result};
use spinney_container::{Metadata, Unit};

/// Meaning of a channel's numbers: number * factor + summand, in a unit.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::ops) struct Scale {
    factor: f64,
    summand: f64,
    unit: String,
}

impl Scale {
    /// Unscaled numbers in a unit.
    fn plain(unit: &str) -> Scale {
        Scale { factor: 1.0, summand: 0.0, unit: unit.into() }
    }

    /// Scale of a channel.
    pub(in crate::ops) fn of(metadata: &Metadata, channel: usize) -> Scale {
        let (factor, summand) = metadata.scale_offset.get(channel).copied().unwrap_or((1.0, 0.0));
        Scale { factor, summand, unit: metadata.units.get(channel).cloned().unwrap_or_default() }
    }

    /// Factor and summand from stored numbers to their meaning.
    pub(in crate::ops) fn plain_numbers(&self) -> (f64, f64) {
        (self.factor, self.summand)
    }

    /// Factor and summand from stored numbers to their meaning in the unit of another scale; `None`
    /// if the units measure different quantities.
    pub(in crate::ops) fn to_unit_of(&self, other: &Scale) -> Option<(f64, f64)> {
        let (factor, summand) = converted(&other.unit, &self.unit)?;
        Some((self.factor * factor, self.summand * factor + summand))
    }
}

/// Type of values, and their scales.
#[derive(Clone, Debug)]
pub(super) struct ValueSpace {
    pub(super) value: ValueType,
    pub(super) scales: Vec<Scale>,
}

impl ValueSpace {
    /// Writes scale, offset and units into metadata.
    pub(super) fn describe(&self, metadata: &mut Metadata) {
        let pairs: Vec<(f64, f64)> = self.scales.iter().map(|scale| (scale.factor, scale.summand)).collect();
        let is_plain = pairs.iter().all(|pair| *pair == (1.0, 0.0));
        metadata.scale_offset = if is_plain { Vec::new() } else { pairs };
        let has_units = self.scales.iter().any(|scale| !scale.unit.is_empty());
        metadata.units =
            if has_units { self.scales.iter().map(|scale| scale.unit.clone()).collect() } else { Vec::new() };
        if self.value.mask == Mask::Alpha {
            metadata.alpha = Some(self.value.channels - 1);
        }
    }
}

/// Operand whose values are needed.
pub(super) struct Valued<'a> {
    /// Index among all operands.
    number: usize,
    name: &'a str,
    pub(super) view: &'a View,
    /// Maximum new number of its classes, if some get another number.
    classes_to: Option<f64>,
}

impl<'a> Valued<'a> {
    /// Operand, some of whose classes may get other numbers.
    pub(super) fn of(number: usize, (name, view): &'a (String, View), classes: &[Renumbered]) -> Valued<'a> {
        let classes_to = classes.iter().map(|class| class.to.to_f64()).reduce(f64::max);
        Valued { number, name, view, classes_to }
    }

    fn value(&self) -> ValueType {
        self.view.form().value
    }

    fn metadata(&self) -> &Metadata {
        self.view.source().metadata()
    }

    fn scale(&self, channel: usize) -> Scale {
        Scale::of(self.metadata(), channel)
    }

    /// Minimum and maximum of all channels after a map; `None` if there are no cells.
    fn range(&self, map: &Maps) -> Result<Option<(f64, f64)>> {
        let totals = self.view.source().totals(None)?;
        let channels = totals.channels.iter().zip(map).filter(|(channel, _)| channel.cells > 0);
        let ends = channels.map(|(channel, (factor, summand))| {
            let at = |number: Number| number.to_f64() * factor + summand;
            let (a, b) = (at(channel.min), at(channel.max));
            (a.min(b), a.max(b))
        });
        let classes = self.classes_to.map(|most| (most, most));
        Ok(ends.chain(classes).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))))
    }
}

/// Factor and summand of each channel.
type Maps = [(f64, f64); 4];

/// Identity maps.
const PLAIN: Maps = [(1.0, 0.0); 4];

/// Smallest space that contains the values of all operands, and the maps of those operands whose
/// values change, by operand index.
///
/// # Errors
/// If numbers would be lost, units measure different quantities, or numbers of channels differ.
pub(super) fn common(
    operands: &[Valued<'_>],
    options: &ReconcileOptions,
    is_fixed: bool,
) -> Result<(ValueSpace, BTreeMap<usize, ValueMap>)> {
    let first = &operands[0];
    let channels = channels(operands, is_fixed)?;
    let mut scales =
        if options.units_by_number { own_scales(first, channels) } else { units(operands, channels)? };
    let mask = mask(operands, channels);
    let of = |sample: SampleType| ValueType { sample, channels, mask };
    let mut maps = maps(operands, &scales, options);
    let all_integers = operands.iter().all(|operand| !operand.value().sample.is_float());
    let are_whole = maps.iter().flatten().all(is_whole);
    let sample = match is_fixed {
        true => {
            check_fixed(operands, &maps, options)?;
            first.value().sample
        }
        false if all_integers && are_whole => integer(operands, &maps, channels)?,
        false if all_integers => {
            // If the first operand's scale cannot express all values, unscaled numbers of its unit
            // can.
            scales = scales.iter().map(|scale| Scale::plain(&scale.unit)).collect();
            maps = self::maps(operands, &scales, options);
            floating(operands, channels)?
        }
        false => floating(operands, channels)?,
    };
    let value = of(sample);
    if !value.is_supported() {
        let expected = "u8, u16 or f32 for several channels";
        return Err(Error::invalid("type of the result", value.to_string(), expected));
    }
    let maps = operands.iter().zip(maps).map(|(operand, map)| {
        let stays = operand.value() == value && map == PLAIN;
        (!stays).then_some((operand.number, ValueMap::Linear(map)))
    });
    Ok((ValueSpace { value, scales }, maps.flatten().collect()))
}

/// Number of channels of the result: all operands must have the same number, except for opacity.
fn channels(operands: &[Valued<'_>], is_fixed: bool) -> Result<u8> {
    let has_alpha = |operand: &Valued<'_>| {
        let channels = operand.value().channels;
        operand.value().mask == Mask::Alpha || operand.metadata().alpha == Some(channels - 1) && channels > 1
    };
    let first = &operands[0];
    let colours = |operand: &Valued<'_>| operand.value().channels - u8::from(has_alpha(operand));
    let most = operands.iter().map(|operand| operand.value().channels).max().unwrap_or(1);
    for operand in &operands[1..] {
        let is_same = colours(operand) == colours(first);
        if !is_same || is_fixed && operand.value().channels > first.value().channels {
            let step = channels_step(operand.value(), colours(first));
            let expected = format!(
                "{}, like {}; to convert it: `spinney transform {} {step} -o OTHER.goblin`",
                first.value(),
                first.name,
                operand.name,
            );
            return Err(Error::invalid(
                format!("channels of {}", operand.name),
                operand.value().to_string(),
                expected,
            ));
        }
    }
    Ok(if is_fixed { first.value().channels } else { most })
}

/// Operation that gives values `wanted` channels: the first ones, repeating the last if there are
/// fewer.
fn channels_step(value: ValueType, wanted: u8) -> String {
    let channel = |number: u8| format!("b{}", number.min(value.channels));
    match wanted {
        1 => format!("calc=b1,type={}", value.sample.name()),
        _ => format!("composite={}", (1..=wanted).map(channel).collect::<Vec<_>>().join(",")),
    }
}

/// Which samples count in the result: with opacity if one operand has it.
fn mask(operands: &[Valued<'_>], channels: u8) -> Mask {
    let first = operands[0].value();
    let has_alpha = operands.iter().any(|operand| operand.value().mask == Mask::Alpha);
    if has_alpha && first.channels < channels { Mask::Alpha } else { first.mask }
}

fn own_scales(operand: &Valued<'_>, channels: u8) -> Vec<Scale> {
    (0..usize::from(channels)).map(|channel| operand.scale(channel)).collect()
}

/// Scales of the first operand, in its units, or in those of another operand if it has none.
fn units(operands: &[Valued<'_>], channels: u8) -> Result<Vec<Scale>> {
    let mut scales = own_scales(&operands[0], channels);
    for (channel, scale) in scales.iter_mut().enumerate() {
        for operand in &operands[1..] {
            let theirs = operand.scale(channel).unit;
            if scale.unit.is_empty() {
                scale.unit = theirs;
            } else if !theirs.is_empty() && converted(&scale.unit, &theirs).is_none() {
                let expected = format!(
                    "{}, like {}, or another unit of the same quantity; --units number ignores units",
                    scale.unit, operands[0].name
                );
                return Err(Error::invalid(format!("unit of {}", operand.name), theirs, expected));
            }
        }
    }
    Ok(scales)
}

/// Factor and summand from a unit to another, by their names; `None` if unknown.
fn converted(to: &str, from: &str) -> Option<(f64, f64)> {
    if to.is_empty() || from.is_empty() || to.eq_ignore_ascii_case(from) {
        return Some((1.0, 0.0));
    }
    Unit::parse(to)?.from(Unit::parse(from)?)
}

/// Maps from the numbers of all operands to those of some scales.
fn maps(operands: &[Valued<'_>], scales: &[Scale], options: &ReconcileOptions) -> Vec<Maps> {
    let map = |operand: &Valued<'_>| {
        let mut maps = PLAIN;
        if options.units_by_number {
            return maps;
        }
        for (channel, (map, to)) in maps.iter_mut().zip(scales).enumerate() {
            let from = operand.scale(channel);
            // (Units that cannot be converted were rejected.)
            let (factor, summand) = converted(&to.unit, &from.unit).unwrap_or((1.0, 0.0));
            let by = from.factor * factor / to.factor;
            let plus = (from.summand * factor + summand - to.summand) / to.factor;
            *map = (near_whole(by), near_whole(plus));
        }
        maps
    };
    operands.iter().map(map).collect()
}

/// Relative tolerance within which a quotient of scales is rounded to an integer. Scales are
/// decimal fractions (0.3 / 0.1 is 2.9999999999999996), whose quotients are off by a few times
/// 2^-53, and have fewer digits than nine.
const DECIMAL_ROUNDING: f64 = 1e-9;

/// Rounds a number that is an integer except for [rounding errors](DECIMAL_ROUNDING).
fn near_whole(number: f64) -> f64 {
    let whole = number.round();
    if (number - whole).abs() <= DECIMAL_ROUNDING * whole.abs().max(1.0) { whole } else { number }
}

fn is_whole((factor, summand): &(f64, f64)) -> bool {
    *factor == factor.trunc() && *summand == summand.trunc()
}

/// Smallest floating-point type that holds the values of all operands.
fn floating(operands: &[Valued<'_>], channels: u8) -> Result<SampleType> {
    let needs_f64 = |operand: &&Valued<'_>| {
        let sample = operand.value().sample;
        sample == SampleType::F64 || !sample.is_float() && sample.size() >= 4
    };
    let Some(wide) = operands.iter().find(needs_f64) else { return Ok(SampleType::F32) };
    for operand in operands.iter().filter(|operand| operand.value().sample.is_wide_integer()) {
        // (The actual numbers decide if the type alone does not.)
        if !within(operand, &PLAIN, (1u64 << 53) as f64)? {
            return Err(loss(operand, "a type that stores all numbers (f64 does not)", "calc=b1,type=f64"));
        }
    }
    if channels > 1 {
        let what = format!("{channels} channels of f32 (numbers of {} have more digits)", wide.name);
        return Err(loss(wide, &what, "calc=b1,type=f32"));
    }
    Ok(SampleType::F64)
}

/// Minimum and maximum of an integer type.
fn ends(sample: SampleType) -> (f64, f64) {
    let bits = 8 * sample.size() as i32;
    match sample {
        SampleType::U8 | SampleType::U16 | SampleType::U32 | SampleType::U64 => (0.0, 2f64.powi(bits) - 1.0),
        _ => (-2f64.powi(bits - 1), 2f64.powi(bits - 1) - 1.0),
    }
}

/// First integer type that holds the values of all operands.
fn integer(operands: &[Valued<'_>], maps: &[Maps], channels: u8) -> Result<SampleType> {
    use SampleType::{I8, I16, I32, I64, U8, U16, U32, U64};
    let candidates: &[SampleType] =
        if channels > 1 { &[U8, U16] } else { &[U8, I8, U16, I16, U32, I32, U64, I64] };
    let holding = |ranges: &[(f64, f64)]| {
        let holds = |sample: &&SampleType| {
            let (low, high) = ends(**sample);
            ranges.iter().all(|(least, most)| low <= *least && *most <= high)
        };
        candidates.iter().find(holds).copied()
    };
    // By type if numbers stay unchanged, so that the result's type does not depend on the files'
    // contents.
    let by_type = |(operand, map): (&Valued<'_>, &Maps)| match (operand.classes_to, *map == PLAIN) {
        (Some(most), _) => {
            Ok(Some((ends(operand.value().sample).0, most.max(ends(operand.value().sample).1))))
        }
        (None, true) => Ok(Some(ends(operand.value().sample))),
        (None, false) => operand.range(map),
    };
    let ranges = operands.iter().zip(maps).map(by_type).collect::<Result<Vec<_>>>()?;
    let first = ends(operands[0].value().sample);
    let ranges: Vec<(f64, f64)> = ranges.into_iter().flatten().chain([first]).collect();
    if let Some(sample) = holding(&ranges) {
        return Ok(sample);
    }
    // For 64-bit numbers with and without a sign, the actual numbers decide.
    let ranges = operands.iter().zip(maps).map(|(operand, map)| operand.range(map));
    let ranges: Vec<(f64, f64)> = ranges.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect();
    let last = &operands[operands.len() - 1];
    holding(&ranges)
        .ok_or_else(|| loss(last, "numbers of all operands within one integer type", "calc=b1,type=f64"))
}

/// Fails if numbers would be lost by conversion to the first operand's type.
fn check_fixed(operands: &[Valued<'_>], maps: &[Maps], options: &ReconcileOptions) -> Result<()> {
    let to = operands[0].value().sample;
    if options.round {
        return Ok(());
    }
    for (operand, map) in operands.iter().zip(maps).skip(1) {
        let from = operand.value().sample;
        let is_plain = *map == PLAIN;
        let fits = match (from.is_float(), to.is_float()) {
            (true, true) => from.size() <= to.size(),
            (true, false) => false,
            (false, true) => {
                from.size() < to.size()
                    || within(operand, map, 2f64.powi(if to.size() == 8 { 53 } else { 24 }))?
            }
            (false, false) if is_plain && from == to => true,
            (false, false) => {
                let range = operand.range(map)?.unwrap_or((0.0, 0.0));
                map.iter().all(is_whole) && ends(to).0 <= range.0 && range.1 <= ends(to).1
            }
        };
        if !fits {
            let found =
                format!("{from}, with numbers that {} cannot store", operands[0].name, from = from.name());
            let expected = format!("{}; --round stores the nearest numbers instead", to.name());
            return Err(Error::invalid(format!("type of {}", operand.name), found, expected));
        }
    }
    Ok(())
}

/// Whether the absolute values of all numbers are at most `most`.
fn within(operand: &Valued<'_>, map: &Maps, most: f64) -> Result<bool> {
    Ok(operand.range(map)?.is_none_or(|(low, high)| low.abs().max(high.abs()) <= most))
}

#[cold]
fn loss(operand: &Valued<'_>, expected: &str, step: &str) -> Error {
    let expected = format!(
        "{expected}; to convert it to the nearest numbers: `spinney transform {} {step} -o OTHER.goblin`",
        operand.name
    );
    Error::invalid(format!("type of {}", operand.name), operand.value().to_string(), expected)
}
