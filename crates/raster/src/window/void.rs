//! The number that encodes VOID in an output. It is chosen from the bounds of all values before the
//! first byte is written.

use std::path::Path;

use super::has_opacity;
use crate::image::Format;
use spinney_base::space::Bounds;
use spinney_base::value::{DataKind, Mask, Number, Rule, SampleType};
use spinney_base::{Error, Progress, Result};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::Condition;

/// VOID cells of an output and their encoding.
pub(crate) struct VoidCells {
    /// Whether cells may be VOID; `false` is certain.
    pub(crate) may_be: bool,
    /// The number for VOID; `None` if every number may be a value.
    pub(crate) fill: Option<Number>,
    /// The layer's own nodata number, if it was rejected because it may be a value.
    pub(crate) replaced: Option<Number>,
}

impl VoidCells {
    /// Decides the encoding for a box of cells in layers of one sample type. `requested` is the
    /// caller's number.
    pub(crate) fn of(layers: &[Dataset], bounds: Bounds, requested: Option<Number>) -> Result<VoidCells> {
        let mut may_be = false;
        for layer in layers {
            // In trees of occupancy VOID is a number: an empty cell.
            may_be |= layer.header().rule != Rule::Occupancy && layer.may_have_void(bounds)?;
        }
        let fill = decide(layers, requested, false)?;
        let own = layers.first().and_then(|layer| layer.metadata().nodata);
        let replaced =
            own.filter(|own| requested.is_none() && fill != Some(*own) && !is_encoded_by_value(layers));
        Ok(VoidCells { may_be, fill, replaced })
    }

    /// Uses NaN for VOID in floating-point files that have no tag to name another number.
    pub(crate) fn without_tag(&mut self, tree: &Dataset) {
        let is_float = tree.header().form.value.sample.is_float();
        if is_float && self.fill.is_some() && !is_encoded_by_value(std::slice::from_ref(tree)) {
            (self.fill, self.replaced) = (Some(Number::NAN), None);
        }
    }

    /// The VOID cells of a painted image, where colours encode VOID.
    pub(crate) fn painted(tree: &Dataset, bounds: Bounds) -> Result<VoidCells> {
        let may_be = tree.header().rule != Rule::Occupancy && tree.may_have_void(bounds)?;
        Ok(VoidCells { may_be, fill: None, replaced: None })
    }

    /// Whether a TIFF file needs a mask.
    pub(crate) fn needs_mask(&self) -> bool {
        self.may_be && self.fill.is_none()
    }

    /// Checks that a format can encode VOID, and warns if the layer's own nodata number is not
    /// used.
    pub(crate) fn check(
        &self,
        (path, sample): (&Path, SampleType),
        format: Format,
        progress: &dyn Progress,
    ) -> Result<()> {
        if !self.may_be {
            return Ok(());
        }
        let sample = sample.name();
        match (self.fill, self.replaced, format) {
            (None, _, Format::Npy | Format::Raw | Format::Nrrd | Format::Exr) => {
                let found = format!(
                    "VOID cells in a file without a mask, where every number of type {sample} is a value,"
                );
                let advice = "write .tif, which has a mask, or .png, which has opacity";
                Err(Error::unsupported(path, found, advice))
            }
            (None, _, Format::Tiff) => {
                let text =
                    format!("has a mask for VOID cells, since every number of type {sample} is a value");
                progress.warn(path, &text);
                Ok(())
            }
            (Some(fill), Some(own), Format::Tiff | Format::Npy | Format::Raw | Format::Nrrd) => {
                let text = format!(
                    "has {fill} as nodata number, since {own}, that of the layer, is within its values"
                );
                progress.warn(path, &text);
                Ok(())
            }
            _ => Ok(()),
        }
    }
}

/// Whether VOID needs no extra number: where it means empty, or has opacity 0.
fn is_encoded_by_value(layers: &[Dataset]) -> bool {
    matches!(layers, [tree] if has_opacity(tree) || tree.header().rule == Rule::Occupancy)
}

/// Returns the number for VOID cells in every output of a tree that encodes VOID by a number.
///
/// - 0 in trees of [`Rule::Occupancy`], where it means empty, and in trees with opacity;
/// - otherwise the tree's own nodata number, if no value can be equal to it;
/// - otherwise NaN for floating-point samples;
/// - otherwise the minimum or maximum of the type, if it is below or above all values, or the
///   number of no class;
/// - `None` if none of these is free.
///
/// The result depends on the layer only, and so is the same for every window and level.
///
/// # Errors
/// If the tree's statistics are corrupt.
pub fn void_number(tree: &Dataset) -> Result<Option<Number>> {
    decide(std::slice::from_ref(tree), None, false)
}

/// Returns the number that encodes VOID in outputs of several layers of one sample type: the
/// caller's number, or a number that no value of a layer can be equal to. With `convolved`, values
/// are cubic convolutions of the layers' values.
///
/// # Errors
/// If the caller's number is not of the type, or lies within the range of the values; if statistics
/// are corrupt.
pub(crate) fn decide(
    layers: &[Dataset],
    requested: Option<Number>,
    convolved: bool,
) -> Result<Option<Number>> {
    let Some(first) = layers.first() else { return Ok(requested) };
    let sample = first.header().form.value.sample;
    if let Some(number) = requested.filter(|number| !sample.is_float() && !sample.can_hold(*number)) {
        let expected = format!("a number of type {}", sample.name());
        return Err(Error::invalid("nodata", number.to_string(), expected));
    }
    if is_encoded_by_value(layers) {
        let is_empty = first.header().rule == Rule::Occupancy;
        return match requested {
            Some(number) if !is_empty && number != Number::default() => {
                let expected = "0, since the opacity of VOID cells is 0";
                Err(Error::invalid("nodata", number.to_string(), expected))
            }
            requested => Ok(Some(requested.unwrap_or_default())),
        };
    }
    let own = layers.iter().filter_map(|layer| layer.metadata().nodata);
    let fits = |number: &Number| {
        if sample.is_float() { fits_float(sample, *number) } else { sample.can_hold(*number) }
    };
    let mut candidates: Vec<Number> = requested.into_iter().chain(own.filter(fits)).collect();
    if sample.is_float() {
        candidates.push(Number::NAN);
    }
    let ends = [f64::NEG_INFINITY, f64::INFINITY].map(|end| sample.nearest(end.into()));
    // NaN is never a value. This saves the bounds, which take a pass over some views.
    if candidates.first().is_some_and(|first| first.is_nan()) {
        return Ok(Some(Number::NAN));
    }
    let mut bounds = Vec::new();
    for layer in layers {
        bounds.push(layer.outer_bounds(convolved)?);
    }
    let is_free_in = |at: usize, number: Number| {
        let layer = &layers[at];
        number.is_nan()
            // A sample equal to the number is missing by definition.
            || is_missing(layer, number)
            || bounds[at].iter().all(|bounds| is_outside(sample, number, *bounds))
                && !(layer.header().rule == Rule::Occupancy && number == Number::default())
    };
    let is_free_by_bounds = |number: &Number| (0..layers.len()).all(|at| is_free_in(at, *number));
    let is_free = |number: &Number| -> Result<bool> {
        for (at, layer) in layers.iter().enumerate() {
            if !is_free_in(at, *number) && !is_unused_class(layer, *number)? {
                return Ok(false);
            }
        }
        Ok(true)
    };
    // A search for a class reads nodes, of remote files possibly all. So the ends of the type are
    // compared with the bounds before either is searched for.
    let first_free = |given: &[Number]| -> Result<Option<Number>> {
        for number in given {
            if is_free(number)? {
                return Ok(Some(*number));
            }
        }
        if let Some(end) = ends.iter().find(|end| is_free_by_bounds(end)) {
            return Ok(Some(*end));
        }
        for end in &ends {
            if is_free(end)? {
                return Ok(Some(*end));
            }
        }
        Ok(None)
    };
    let free = first_free(&candidates)?;
    match requested {
        Some(number) if free != Some(number) && !number.is_nan() => {
            let others = first_free(&candidates[1..])?;
            let advice = others.map_or("no number, for which TIFF files have a mask".into(), |number| {
                format!("a number that no value has, such as the default {number}")
            });
            let all = bounds.iter().flatten();
            let low = all.clone().map(|(min, _)| *min).min().unwrap_or_default();
            let high = all.map(|(_, max)| *max).max().unwrap_or_default();
            Err(Error::invalid("nodata", format!("{number}, within the values ({low} to {high})"), advice))
        }
        _ => Ok(free),
    }
}

/// Whether a number within the bounds of a categorical layer is none of its classes. Coarse levels
/// and resampling make no new classes. Costs a search, which reads all nodes whose bounds include
/// the number.
fn is_unused_class(layer: &Dataset, number: Number) -> Result<bool> {
    let header = layer.header();
    if header.kind != DataKind::Categorical || header.form.value.channels != 1 || header.rule == Rule::Mean {
        return Ok(false);
    }
    let mut is_used = false;
    layer.find(Condition::Equal(number), None, &(), &mut |_| {
        is_used = true;
        Ok(false)
    })?;
    Ok(!is_used)
}

/// Whether a floating-point type holds a number, at least rounded.
fn fits_float(sample: SampleType, number: Number) -> bool {
    !number.is_finite() || sample.nearest(number).is_finite()
}

/// Whether a number lies outside of bounds.
fn is_outside(sample: SampleType, number: Number, (min, max): (Number, Number)) -> bool {
    if sample.is_float() {
        let (number, min, max) = (sample.nearest(number).to_f64(), min.to_f64(), max.to_f64());
        number < min || number > max
    } else {
        number < min || number > max
    }
}

/// Whether samples equal to a number are missing in a tree.
fn is_missing(tree: &Dataset, number: Number) -> bool {
    let value = tree.header().form.value;
    matches!(value.mask, Mask::Missing(_))
        && value
            .all_missing()
            .is_some_and(|missing| value.first_number(missing) == value.sample.nearest(number))
}
