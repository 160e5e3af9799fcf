//! Composites: a channel of each of several layers, unchanged, side by side in one tree.

use super::operands::Operands;
use crate::ops::affine::View;
use crate::tree::Source;
use spinney_base::value::{DataKind, Number, Rule, SampleType, ValueType};
use spinney_base::{Error, Result};
use spinney_container::{Metadata, Tag};

/// Type, kind and rule of a composite's values.
///
/// # Errors
/// If the layers' sample types differ, trees cannot have several channels of that type, or a layer
/// is corrupt.
pub(super) fn values(operands: &Operands) -> Result<(ValueType, DataKind, Rule)> {
    let headers = || operands.read().map(|tree| tree.source().header());
    let name =
        |tree: &View| format!("`{}` of {}", tree.source().metadata().name, tree.form().value.sample.name());
    let samples: Vec<SampleType> = headers().map(|header| header.form.value.sample).collect();
    let value = ValueType::new(samples[0], samples.len() as u8);
    let is_alike = samples.iter().all(|sample| *sample == samples[0]);
    if !is_alike || !value.is_supported() {
        let found = operands.read().map(name).collect::<Vec<_>>().join(", ");
        let expected = "layers of one type: u8, u16 or f32; to convert a layer: \
                        `spinney transform FILE:LAYER calc=b1,type=f32 -o LAYER.goblin`";
        return Err(Error::invalid("composite", found, expected));
    }
    // If all layers have the same rule, so has the composite.
    let alike = |rule: Rule| headers().all(|header| header.rule == rule);
    let kind = match headers().all(|header| header.kind == DataKind::Categorical) {
        true => DataKind::Categorical,
        false => DataKind::Continuous,
    };
    let first = operands.trees[0].source().header().rule;
    let rule = if alike(first) && first != Rule::Occupancy { first } else { kind.default_rule() };
    let value = match missing(operands, value)? {
        Some(missing) => value.with_missing(missing),
        None => value,
    };
    Ok((value, kind, rule))
}

/// Sample that no layer has: it marks a cell that is VOID in one channel while others have a
/// sample. `None` if every layer has all samples, or all numbers are in use; a cell that is VOID in
/// one layer is then VOID in the composite.
fn missing(operands: &Operands, value: ValueType) -> Result<Option<Number>> {
    let (mut bounds, mut is_full) = (Vec::new(), true);
    for tree in operands.read() {
        let source = tree.source();
        let totals = source.totals(None)?;
        let extent = source.header().extent;
        is_full &= tree.shows_all() && totals.cells == extent.iter().product::<u64>();
        bounds.extend(totals.channels.iter().map(|channel| (channel.min, channel.max)));
    }
    if is_full {
        return Ok(None);
    }
    let own = operands.read().filter_map(|tree| tree.source().metadata().nodata);
    let usual: &[f64] = match value.sample {
        SampleType::U8 => &[0.0, 255.0],
        SampleType::U16 => &[0.0, 65535.0],
        _ => &[-9999.0, -3.402_823_466_385_288_6e38],
    };
    let is_free = |number: &Number| {
        value.with_missing(*number).is_masked()
            && bounds.iter().all(|(min, max)| number < min || number > max)
    };
    Ok(own.chain(usual.iter().map(|number| Number::from(*number))).find(is_free))
}

/// Copies the description of the layers to the composite's channels.
pub(super) fn describe(operands: &Operands, value: ValueType, metadata: &mut Metadata) {
    let channels = || {
        operands.operands.iter().map(|operand| {
            let tree = &operands.trees[operand.tree];
            (tree.source().metadata(), operand.channel)
        })
    };
    let name = |(of, channel): (&Metadata, usize)| {
        let band = of.band_names.get(channel).filter(|name| !name.is_empty());
        match (of.name.is_empty(), band) {
            (false, Some(band)) if *band != of.name => format!("{}: {band}", of.name),
            (true, Some(band)) => band.clone(),
            _ => of.name.clone(),
        }
    };
    metadata.band_names = channels().map(name).collect();
    let units: Vec<String> =
        channels().map(|(of, channel)| of.units.get(channel).cloned().unwrap_or_default()).collect();
    if units.iter().any(|unit| !unit.is_empty()) {
        metadata.units = units;
    }
    if channels().any(|(of, _)| !of.scale_offset.is_empty()) {
        let scale =
            |(of, channel): (&Metadata, usize)| of.scale_offset.get(channel).copied().unwrap_or((1.0, 0.0));
        metadata.scale_offset = channels().map(scale).collect();
    }
    metadata.nodata = value.all_missing().map(|missing| value.first_number(missing));
    let time = &operands.trees[operands.operands[0].tree].source().metadata().time;
    if channels().all(|(of, _)| of.time == *time) {
        metadata.time.clone_from(time);
    }
    // (Colour roles of the first layer's channels do not apply to the composite's channels.)
    metadata.tags.remove(Tag::ColourRoles.key());
    if value.channels == 2 {
        metadata.set_colour_roles(&["Red".into(), "Cyan".into()]);
    }
}
