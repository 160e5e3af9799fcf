//! Information that is lost when features are written to a format.

use super::geometry::Shape;
use super::layer::TEXT_BYTES;
use super::{AttributeType, AttributeValue, GeometryKind, VectorFeature, VectorFormat, VectorLayer};

/// Bound up to which all integers are exact in double precision.
const EXACT: u64 = 1 << f64::MANTISSA_DIGITS;

/// Maximum number of names that are listed.
const LISTED: usize = 20;

/// Losses of single features.
#[derive(Clone, Copy)]
enum Loss {
    Id,
    Infinite,
    Rounded,
    Cut,
    Blank,
    Control,
    Unplaced,
    Zero,
}

/// Message for each loss, before its count.
const MESSAGES: [&str; 8] = [
    "dropped ids, since the format has none",
    "dropped infinite numbers",
    "rounded integers beyond 2^53",
    "strings truncated to 254 bytes",
    "empty strings or trailing blanks that the format cannot distinguish",
    "strings with control characters replaced by blanks",
    "features with dropped attributes, since they have no edges",
    "missing segment attributes written as 0",
];

/// Loss counts.
pub(super) struct Losses {
    format: VectorFormat,
    counts: [u64; MESSAGES.len()],
}

impl Losses {
    pub(super) fn new(format: VectorFormat) -> Losses {
        Losses { format, counts: [0; MESSAGES.len()] }
    }

    fn add(&mut self, loss: Loss, is_lost: bool) {
        self.counts[loss as usize] += u64::from(is_lost);
    }

    /// Counts the losses of a feature.
    pub(super) fn count(
        &mut self,
        feature: &VectorFeature<'_>,
        shape: Option<&Shape<'_>>,
        attributes: &[(String, AttributeType)],
    ) {
        let format = self.format;
        let has_ids = matches!(format, VectorFormat::GeoJson | VectorFormat::GeoPackage);
        self.add(Loss::Id, feature.id.is_some() && !has_ids);
        for (value, (_, kind)) in feature.attributes.iter().zip(attributes) {
            self.count_value(value, *kind);
        }
        if format == VectorFormat::Ply {
            // PLY stores attributes with edges.
            let kinds = shape.iter().flat_map(|shape| &shape.members).map(|(kind, _)| *kind);
            let has_edges = kinds.into_iter().any(|kind| kind != GeometryKind::Point);
            let has_values =
                feature.attributes.iter().any(|value| value.finite_or_none() != AttributeValue::None);
            self.add(Loss::Unplaced, !has_edges && has_values);
            let values = feature.attributes.iter().zip(attributes).filter(|(value, (_, kind))| {
                **value == AttributeValue::None && *kind == AttributeType::PerSegment
            });
            self.counts[Loss::Zero as usize] += if has_edges { values.count() as u64 } else { 0 };
        }
    }

    fn count_value(&mut self, value: &AttributeValue<'_>, kind: AttributeType) {
        use VectorFormat::{Csv, FlatGeobuf, GeoPackage, Obj, Ply, Shapefile, Svg};
        match value {
            AttributeValue::Number(number) => self.add(Loss::Infinite, number.is_infinite()),
            AttributeValue::Integer(number) => {
                let is_double = match self.format {
                    GeoPackage | FlatGeobuf => kind == AttributeType::Number,
                    Ply => true,
                    _ => false,
                };
                self.add(Loss::Rounded, is_double && number.unsigned_abs() > EXACT);
            }
            AttributeValue::Text(text) | AttributeValue::Json(text) => {
                let (is_table, is_drawn) = (self.format == Shapefile, matches!(self.format, Svg | Obj));
                self.add(Loss::Cut, is_table && text.len() > TEXT_BYTES);
                let is_blank = is_table && (text.is_empty() || text.ends_with([' ', '\0']));
                self.add(Loss::Blank, is_blank || self.format == Csv && text.is_empty());
                self.add(Loss::Control, is_drawn && text.contains(char::is_control));
            }
            AttributeValue::Boolean(_) | AttributeValue::PerSegment(_) | AttributeValue::None => {}
        }
    }

    /// Returns messages about the losses of features.
    pub(super) fn messages(&self) -> Vec<String> {
        let lost = MESSAGES.iter().zip(self.counts).filter(|(_, count)| *count > 0);
        lost.map(|(text, count)| format!("{text}: {count}")).collect()
    }
}

/// Returns remarks on what the format loses of a layer. `names` are the attribute names in the
/// file.
pub(super) fn of_layer(format: VectorFormat, layer: &VectorLayer, names: &[String]) -> Vec<String> {
    let mut remarks: Vec<String> = layer.unknown_system(format).into_iter().collect();
    let renamed = layer.attributes.iter().zip(names).filter(|((own, _), name)| own != *name);
    let renamed: Vec<String> = renamed.map(|((own, _), name)| format!("`{own}` is `{name}`")).collect();
    if !renamed.is_empty() {
        remarks.push(format!("attributes are renamed: {}", listed(&renamed)));
    }
    if format == VectorFormat::Ply {
        use AttributeType::{Integer, Number, PerSegment};
        let is_numeric = |kind: &AttributeType| matches!(kind, Integer | Number | PerSegment);
        let lost = layer.attributes.iter().filter(|(_, kind)| !is_numeric(kind));
        let lost: Vec<String> = lost.map(|(name, _)| format!("`{name}`")).collect();
        if !lost.is_empty() {
            remarks.push(format!("attributes that are not numbers are dropped: {}", listed(&lost)));
        }
    }
    if format == VectorFormat::Svg && layer.has_z {
        remarks.push("the third coordinate is dropped, since the format is two-dimensional".into());
    }
    remarks
}

/// Lists the first names, and the number of further ones.
fn listed(names: &[String]) -> String {
    let more = names.len().saturating_sub(LISTED);
    let first = names[..names.len() - more].join(", ");
    if more > 0 { format!("{first} and {more} more") } else { first }
}
