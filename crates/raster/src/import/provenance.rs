//! Lines of provenance of an import: its inputs, and the user's options.

use std::fmt::Display;
use std::path::PathBuf;

use super::{Band, ImportOptions, RasterInfo};

/// Start of a line on an input.
const INPUT: &str = "raster ";

/// Start of the line on the user's options.
const OPTIONS: &str = "imported with ";

/// Separates options.
const BETWEEN: &str = ", ";

/// Between the number of a mosaic's inputs and the layout of the first one.
const FIRST: &str = ", the first: ";

/// A line per input, and one for the user's options.
pub(crate) fn provenance(inputs: &[PathBuf], info: &RasterInfo, options: &ImportOptions) -> Vec<String> {
    let mut lines: Vec<String> =
        inputs.iter().map(|path| format!("{INPUT}{} ({})", path.display(), info.layout)).collect();
    let mut said = Vec::new();
    let mut say = |name: &str, value: Option<&dyn Display>| {
        said.extend(value.map(|value| format!("{name} {value}")));
    };
    let numbers = |numbers: &[f64]| numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
    let bands =
        options.bands.as_ref().map(|bands| bands.iter().map(Band::to_string).collect::<Vec<_>>().join(","));
    let transform = options.transform.map(|transform| numbers(&transform));
    say("kind", options.kind.as_ref().map(|kind| kind as _));
    say("rule", options.rule.as_ref().map(|rule| rule as _));
    say("bands", bands.as_ref().map(|bands| bands as _));
    say("nodata", options.nodata.as_ref().map(|nodata| nodata as _));
    say("depth", options.depth.as_ref().map(|depth| depth as _));
    say("crs", options.crs.as_ref().map(|crs| crs as _));
    say("transform", transform.as_ref().map(|transform| transform as _));
    say("layer", options.layer.as_ref().map(|layer| layer as _));
    say("page", options.page.as_ref().map(|page| page as _));
    if options.keep_transparent {
        said.push("transparent pixels kept".into());
    }
    if !said.is_empty() {
        lines.push(format!("{OPTIONS}{}", said.join(BETWEEN)));
    }
    lines
}

/// The layout of a mosaic of several inputs, by the layout of the first one.
pub(crate) fn mosaic_layout(count: usize, first: &str) -> String {
    format!("mosaic of {count}{FIRST}{first}")
}

/// Lines of provenance, read back.
pub(crate) struct ImportHistory<'a> {
    lines: &'a [String],
}

impl<'a> ImportHistory<'a> {
    pub(crate) fn of(lines: &'a [String]) -> ImportHistory<'a> {
        ImportHistory { lines }
    }

    /// Returns the value of an option that the user gave: the words after its name.
    pub(crate) fn option(&self, name: &str) -> Option<&'a str> {
        let lines = self.lines.iter().filter_map(|line| line.strip_prefix(OPTIONS));
        let mut options = lines.flat_map(|line| line.split(BETWEEN));
        options.find_map(|option| option.strip_prefix(name)?.strip_prefix(' '))
    }

    /// Returns the paths of the inputs.
    pub(crate) fn inputs(&self) -> Vec<PathBuf> {
        self.input_lines().map(|(path, _)| path.into()).collect()
    }

    /// Returns the layout of the first input.
    pub(crate) fn first_layout(&self) -> &'a str {
        let layout = self.input_lines().next().map_or("", |(_, layout)| layout);
        layout.split_once(FIRST).map_or(layout, |(_, first)| first)
    }

    /// Returns the lines on other things than inputs.
    pub(crate) fn other_lines(&self) -> impl Iterator<Item = &'a String> {
        self.lines.iter().filter(|line| input_of(line).is_none())
    }

    fn input_lines(&self) -> impl Iterator<Item = (&'a str, &'a str)> {
        self.lines.iter().filter_map(|line| input_of(line))
    }
}

/// Returns the path and the layout of a line on an input. (Layouts of files have no parentheses.)
fn input_of(line: &str) -> Option<(&str, &str)> {
    line.strip_prefix(INPUT)?.strip_suffix(')')?.rsplit_once(" (")
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_base::value::SampleType;

    #[test]
    fn lines_are_read_back() {
        let layout = mosaic_layout(2, "GeoTIFF, strips, none");
        let info = RasterInfo { layout, ..RasterInfo::plain([1, 1], SampleType::U8, 1) };
        let inputs = ["a (1).tif".into(), "b.tif".into()];
        let options = ImportOptions {
            bands: Some(vec![Band::Name("B4, red".into())]),
            nodata: Some(3.into()),
            keep_transparent: true,
            ..ImportOptions::default()
        };
        let lines = provenance(&inputs, &info, &options);
        let history = ImportHistory::of(&lines);
        assert_eq!(history.inputs(), inputs);
        assert_eq!(history.first_layout(), "GeoTIFF, strips, none");
        assert_eq!(history.other_lines().count(), 1);
        let found = ["nodata", "transparent", "bands", "crs", "page"].map(|name| history.option(name));
        assert_eq!(found, [Some("3"), Some("pixels kept"), Some("B4"), None, None]);
        let nothing = ImportHistory::of(&[]);
        assert_eq!((nothing.inputs().len(), nothing.first_layout(), nothing.option("crs")), (0, "", None));
    }
}
