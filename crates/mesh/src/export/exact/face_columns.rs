//! Columns of face values that polygon formats store: materials of OBJ, numbers of PLY.

use super::Job;
use super::material_library::MaterialLibrary;
use crate::export::MeshFormat;
use crate::export::obj::line_name;
use crate::export::ply::{FaceProperty, PropertyType};
use crate::import::MATERIAL;
use spinney_base::Result;

/// Columns of a format, found in one pass over the faces.
#[derive(Default)]
pub(super) struct FaceColumns {
    /// Names of the columns that are stored.
    pub(super) names: Vec<String>,
    /// Names of the others.
    pub(super) lost: Vec<String>,
    /// PLY: properties of the stored columns.
    pub(super) properties: Vec<FaceProperty>,
    /// OBJ: text of the material library, if each material has one colour.
    pub(super) library: Option<String>,
    /// OBJ: whether names of materials have characters that the format does not allow.
    pub(super) has_changed_names: bool,
}

impl FaceColumns {
    /// Reads the values of all faces, if the format may store some of the columns.
    pub(super) fn of(job: &Job<'_>, format: MeshFormat) -> Result<FaceColumns> {
        let may_store = |name: &String| match format {
            MeshFormat::Obj => name == MATERIAL,
            MeshFormat::Ply => is_property_name(name),
            _ => false,
        };
        let (names, lost) = job.faces.value_columns()?.into_iter().partition(may_store);
        let mut columns = FaceColumns { names, lost, ..FaceColumns::default() };
        if columns.names.is_empty() {
            return Ok(columns);
        }
        match format {
            MeshFormat::Obj => columns.survey_materials(job)?,
            _ => columns.survey_numbers(job)?,
        }
        Ok(columns)
    }

    fn survey_materials(&mut self, job: &Job<'_>) -> Result<()> {
        let mut library = MaterialLibrary::default();
        job.each_with_values(&[MATERIAL], &mut |face, values| {
            let name = material_name(values[0].as_deref());
            let written = line_name(&name);
            self.has_changed_names |= written != name;
            library.add(&written, face.colours);
            Ok(())
        })?;
        self.library = library.text();
        Ok(())
    }

    fn survey_numbers(&mut self, job: &Job<'_>) -> Result<()> {
        let mut types = vec![Some(PropertyType::Int); self.names.len()];
        let wanted: Vec<&str> = self.names.iter().map(String::as_str).collect();
        job.each_with_values(&wanted, &mut |_, values| {
            for (own, json) in types.iter_mut().zip(values) {
                *own = own.and_then(|own| Some(own.max(property_type(json.as_deref())?)));
            }
            Ok(())
        })?;
        for (name, own) in std::mem::take(&mut self.names).into_iter().zip(types) {
            match own {
                Some(own) => {
                    self.properties.push(FaceProperty { name: name.clone(), number: own });
                    self.names.push(name);
                }
                None => self.lost.push(name),
            }
        }
        Ok(())
    }
}

/// Name of a material from its JSON; empty if there is none.
pub(super) fn material_name(json: Option<&str>) -> String {
    let json = json.unwrap_or("\"\"");
    serde_json::from_str(json).unwrap_or_else(|_| json.into())
}

/// Number in a value of a stored column, or NaN if there is none.
pub(super) fn number(json: Option<&str>) -> f64 {
    json.and_then(|json| json.parse().ok()).unwrap_or(f64::NAN)
}

/// Whether a property of PLY faces may have this name: one word, without a meaning of its own.
fn is_property_name(name: &str) -> bool {
    let own = ["vertex_indices", "vertex_index", "red", "green", "blue"];
    let is_word = !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_graphic());
    is_word && !own.contains(&name.strip_prefix("diffuse_").unwrap_or(name))
}

/// The type that stores a value exactly, if there is one. (NaN marks missing numbers.)
fn property_type(json: Option<&str>) -> Option<PropertyType> {
    const MAX_EXACT: u64 = 1 << f64::MANTISSA_DIGITS;
    let Some(json) = json else { return Some(PropertyType::Double) };
    let is_integer = json.bytes().all(|byte| byte.is_ascii_digit() || byte == b'-');
    if is_integer {
        let number: i64 = json.parse().ok()?;
        let is_short = i32::try_from(number).is_ok();
        let own = if is_short { PropertyType::Int } else { PropertyType::Double };
        return (number.unsigned_abs() <= MAX_EXACT).then_some(own);
    }
    let is_number = json.starts_with(|first: char| first == '-' || first.is_ascii_digit());
    let number: f64 = json.parse().ok().filter(|_| is_number)?;
    number.is_finite().then_some(PropertyType::Double)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_store_numbers_exactly() {
        let (int, double) = (Some(PropertyType::Int), Some(PropertyType::Double));
        for (json, expected) in [
            ("7", int),
            ("-2147483648", int),
            ("2147483648", double),
            ("9007199254740992", double),
            ("9007199254740994", None),
            ("99999999999999999999", None),
            ("0.5", double),
            ("-1e300", double),
            ("1e999", None),
            ("\"7\"", None),
            ("true", None),
            ("[1]", None),
            ("-", None),
        ] {
            assert_eq!(property_type(Some(json)), expected, "{json}");
        }
        assert_eq!(property_type(None), double);
        assert!(number(None).is_nan());
        for (name, expected) in
            [("grade", true), ("red", false), ("", false), ("a b", false), ("\u{e9}", false)]
        {
            assert_eq!(is_property_name(name), expected, "{name}");
        }
    }
}
