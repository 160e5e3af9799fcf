//! Options of imports of pictures as plans tell them.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::value::Number;
use spinney_base::{Error, Result};
use spinney_crs::Crs;
use spinney_engine::store::Packing;
use spinney_raster::import::{Band, ImportOptions, RasterOptions, files_of};

use super::number;
use super::packing::PlannedPacking;

/// Options of an import. Numbers that are no whole ones are texts, so that every digit of them stays.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PlannedImport {
    kind: Option<String>,
    rule: Option<String>,
    bands: Option<Vec<PlannedBand>>,
    nodata: Option<String>,
    depth: Option<u8>,
    crs: Option<Crs>,
    transform: Option<Vec<String>>,
    layer: Option<String>,
    page: Option<usize>,
    keep_transparent: bool,
    packing: PlannedPacking,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
enum PlannedBand {
    Number(usize),
    Name(String),
}

impl PlannedImport {
    pub(super) fn of(import: &ImportOptions) -> PlannedImport {
        let band = |band: &Band| match band {
            Band::Number(number) => PlannedBand::Number(*number),
            Band::Name(name) => PlannedBand::Name(name.clone()),
        };
        PlannedImport {
            kind: import.kind.map(|kind| kind.to_string()),
            rule: import.rule.map(|rule| rule.to_string()),
            bands: import.bands.as_ref().map(|bands| bands.iter().map(band).collect()),
            nodata: import.nodata.map(|nodata| nodata.to_string()),
            depth: import.depth,
            crs: import.crs.clone(),
            transform: import.transform.map(|numbers| numbers.iter().map(f64::to_string).collect()),
            layer: import.layer.clone(),
            page: import.page,
            keep_transparent: import.keep_transparent,
            packing: PlannedPacking::of(import.packing),
        }
    }

    /// The options, with so many bytes of memory.
    pub(super) fn import(&self, memory: Option<u64>) -> Result<ImportOptions> {
        let mut import = ImportOptions::new();
        import.memory = memory;
        import.kind = self.kind.as_deref().map(str::parse).transpose()?;
        import.rule = self.rule.as_deref().map(str::parse).transpose()?;
        import.bands = self.bands.as_ref().map(|bands| bands.iter().map(PlannedBand::band).collect());
        import.nodata = self.nodata.as_deref().map(number::<Number>).transpose()?;
        (import.depth, import.crs, import.layer) = (self.depth, self.crs.clone(), self.layer.clone());
        import.transform = match &self.transform {
            None => None,
            Some(texts) => {
                let numbers = texts.iter().map(|text| number(text)).collect::<Result<Vec<f64>>>()?;
                let numbers = numbers.try_into();
                Some(numbers.map_err(|_| {
                    Error::invalid("transform", format!("{} numbers", texts.len()), "six numbers")
                })?)
            }
        };
        (import.page, import.keep_transparent) = (self.page, self.keep_transparent);
        import.packing = self.packing()?;
        Ok(import)
    }

    pub(super) fn packing(&self) -> Result<Packing> {
        self.packing.packing()
    }

    /// The files that reading a picture looks at.
    pub(super) fn files_of(&self, input: &Path) -> Result<Vec<PathBuf>> {
        let mut options = RasterOptions::new();
        options.layer.clone_from(&self.layer);
        options.page = self.page;
        files_of(input, &options)
    }
}

impl PlannedBand {
    fn band(&self) -> Band {
        match self {
            PlannedBand::Number(number) => Band::Number(*number),
            PlannedBand::Name(name) => Band::Name(name.clone()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_base::value::{DataKind, Rule};
    use spinney_engine::store::Effort;

    #[test]
    fn options_come_back() {
        let mut import = ImportOptions::new();
        let again = |import: &ImportOptions| {
            let text = serde_json::to_string(&PlannedImport::of(import)).unwrap();
            serde_json::from_str::<PlannedImport>(&text).unwrap().import(import.memory).unwrap()
        };
        assert_eq!(again(&import), import);
        (import.kind, import.rule) = (Some(DataKind::Categorical), Some(Rule::Majority));
        import.bands = Some(vec![Band::Number(3), Band::Name("7".into()), Band::Name("NIR".into())]);
        import.nodata = Some(Number::Float(f64::MIN_POSITIVE));
        (import.depth, import.page, import.layer) = (Some(12), Some(1), Some("a".into()));
        import.crs = Some(Crs::epsg(4326));
        import.transform = Some([0.1 + 0.2, 1e-300, -0.0, 5.0, 1.0 / 3.0, 1e17]);
        import.keep_transparent = true;
        import.packing = Packing::packed(Effort::Small).max_error(Some(0.1));
        assert_eq!(again(&import), import);
    }

    #[test]
    fn options_that_are_none_are_refused() {
        for (key, value) in [
            ("kind", "\"odd\""),
            ("rule", "\"odd\""),
            ("nodata", "\"\""),
            ("transform", "[\"1\"]"),
            ("transform", "[\"1\",\"2\",\"3\",\"4\",\"5\",\"x\"]"),
            ("packing", r#"{"codec": "odd", "effort": "fast", "max_error": null}"#),
            ("packing", r#"{"codec": "packed", "effort": "odd", "max_error": null}"#),
            ("packing", r#"{"codec": "packed", "effort": "fast", "max_error": "x"}"#),
        ] {
            let mut json = serde_json::to_value(PlannedImport::of(&ImportOptions::new())).unwrap();
            json[key] = serde_json::from_str(value).unwrap();
            let planned: PlannedImport = serde_json::from_value(json).unwrap();
            assert!(planned.import(None).is_err(), "{key}");
        }
    }
}
