//! Imports that are built in shards, and their options as plans tell them.

use serde::{Deserialize, Serialize};
use spinney_base::value::Number;
use spinney_base::{Error, Result};
use spinney_container::Codec;
use spinney_crs::Crs;
use spinney_engine::store::{Effort, Packing};
use spinney_raster::import::{Band, ImportOptions, StackOptions};

/// Import that is built in shards. Memory, sharing of equal subtrees and times of commits are no part of a plan.
#[derive(Clone, Debug, PartialEq)]
pub enum ShardedImport {
    /// A picture, or several on one grid, as one layer.
    Pictures(ImportOptions),
    /// Pictures beside each other, as layers.
    Stack(StackOptions),
}

impl ShardedImport {
    /// Options that pictures and stacks have in common.
    pub(crate) fn import(&self) -> &ImportOptions {
        match self {
            ShardedImport::Pictures(import) => import,
            ShardedImport::Stack(stack) => &stack.import,
        }
    }

    /// The way in which the file's segments are packed.
    pub(crate) fn packing(&self) -> Packing {
        self.import().packing
    }

    /// With so many bytes of memory.
    pub(crate) fn with_memory(mut self, memory: u64) -> ShardedImport {
        match &mut self {
            ShardedImport::Pictures(import) => import.memory = Some(memory),
            ShardedImport::Stack(stack) => stack.import.memory = Some(memory),
        }
        self
    }
}

/// Options as a plan has them. Numbers that are no whole ones are texts, so that every digit of them stays.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PlannedOptions {
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
    codec: String,
    effort: String,
    max_error: Option<String>,
    /// Options of a stack, if it is one.
    stack: Option<PlannedStack>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlannedStack {
    names: Option<Vec<String>>,
    times: Option<Vec<String>>,
    every_page: bool,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
enum PlannedBand {
    Number(usize),
    Name(String),
}

impl PlannedOptions {
    /// Those of an import.
    pub(crate) fn of(sharded: &ShardedImport) -> PlannedOptions {
        let import = sharded.import();
        let band = |band: &Band| match band {
            Band::Number(number) => PlannedBand::Number(*number),
            Band::Name(name) => PlannedBand::Name(name.clone()),
        };
        let stack = match sharded {
            ShardedImport::Pictures(_) => None,
            ShardedImport::Stack(StackOptions { names, times, every_page, .. }) => {
                Some(PlannedStack { names: names.clone(), times: times.clone(), every_page: *every_page })
            }
        };
        PlannedOptions {
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
            codec: import.packing.codec.name().into(),
            effort: if import.packing.effort == Effort::Small { "small" } else { "fast" }.into(),
            max_error: import.packing.max_error.map(|most| most.to_string()),
            stack,
        }
    }

    /// The import that they are those of.
    pub(crate) fn import(&self) -> Result<ShardedImport> {
        let mut import = ImportOptions::new();
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
        let mut packing = Packing::default();
        packing.codec = self.codec.parse::<Codec>()?;
        packing.effort = Packing::effort_named(&self.effort)?;
        packing.max_error = self.max_error.as_deref().map(number).transpose()?;
        import.packing = packing;
        let Some(planned) = &self.stack else { return Ok(ShardedImport::Pictures(import)) };
        let mut stack = StackOptions::new();
        stack.import = import;
        (stack.names, stack.times) = (planned.names.clone(), planned.times.clone());
        stack.every_page = planned.every_page;
        Ok(ShardedImport::Stack(stack))
    }
}

pub(crate) fn number<T: std::str::FromStr>(text: &str) -> Result<T> {
    text.parse().map_err(|_| Error::invalid("number", format!("`{text}`"), "a number"))
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
    use spinney_base::value::{Kind, Rule};

    #[test]
    fn options_come_back() {
        let mut import = ImportOptions::new();
        let again = |import: &ShardedImport| {
            let text = serde_json::to_string(&PlannedOptions::of(import)).unwrap();
            serde_json::from_str::<PlannedOptions>(&text).unwrap().import().unwrap()
        };
        let pictures = ShardedImport::Pictures(import.clone());
        assert_eq!(again(&pictures), pictures);
        (import.kind, import.rule) = (Some(Kind::Categorical), Some(Rule::Majority));
        import.bands = Some(vec![Band::Number(3), Band::Name("7".into()), Band::Name("NIR".into())]);
        import.nodata = Some(Number::Float(f64::MIN_POSITIVE));
        (import.depth, import.page, import.layer) = (Some(12), Some(1), Some("a".into()));
        import.crs = Some(Crs::epsg(4326));
        import.transform = Some([0.1 + 0.2, 1e-300, -0.0, 5.0, 1.0 / 3.0, 1e17]);
        import.keep_transparent = true;
        import.packing = Packing::packed(Effort::Small).max_error(Some(0.1));
        let pictures = ShardedImport::Pictures(import.clone());
        assert_eq!(again(&pictures), pictures);
        let mut stack = StackOptions::new();
        (stack.import, stack.every_page) = (import, true);
        (stack.names, stack.times) = (Some(vec!["a".into()]), Some(vec!["2024-05-31".into()]));
        let stack = ShardedImport::Stack(stack);
        assert_eq!(again(&stack), stack);
    }

    #[test]
    fn options_that_are_none_are_refused() {
        for (key, value) in [
            ("kind", "\"odd\""),
            ("rule", "\"odd\""),
            ("nodata", "\"\""),
            ("transform", "[\"1\"]"),
            ("transform", "[\"1\",\"2\",\"3\",\"4\",\"5\",\"x\"]"),
            ("codec", "\"odd\""),
            ("effort", "\"odd\""),
            ("max_error", "\"x\""),
        ] {
            let import = ShardedImport::Pictures(ImportOptions::new());
            let mut json = serde_json::to_value(PlannedOptions::of(&import)).unwrap();
            json[key] = serde_json::from_str(value).unwrap();
            let planned: PlannedOptions = serde_json::from_value(json).unwrap();
            assert!(planned.import().is_err(), "{key}");
        }
    }
}
