//! Printed statistics of polygons.

use std::fmt::Write;

use anyhow::Result;
use spinney::query::{ZoneMeasure, ZoneStatistics};
use spinney::raw::export::vector::quantile_name;
use spinney::raw::import::feature::PolygonLayer;
use spinney::raw::query::ZoneChannel;
use spinney::raw::report::{CellMeasure, JsonNumbers, ZoneForm, ZoneReport, class_name, measure_key};
use spinney::{Dataset, Metadata, Number};

use super::super::super::report::print_text;
use super::super::row_of;
use super::ZoneOptions;

/// Format of printed statistics.
#[derive(Clone, Copy)]
pub(in super::super) enum Format {
    Text,
    Json,
    Csv,
}

/// Prints results feature by feature.
pub(super) struct Report<'a> {
    trees: &'a [&'a Dataset],
    options: &'a ZoneOptions,
    format: Format,
    /// Number of the next feature.
    next: usize,
    /// Text that is not printed yet.
    text: String,
    json: ZoneReport<'a>,
}

/// Maximum size of buffered text, in bytes: more is printed before the end, so that memory does not
/// grow with polygons times layers.
const MAX_TEXT: usize = 32 << 20;

impl<'a> Report<'a> {
    /// Begins a report, with the text before all features.
    pub(super) fn begin(trees: &'a [&'a Dataset], options: &'a ZoneOptions, format: Format) -> Report<'a> {
        let text = match format {
            Format::Csv => csv_heading(trees, options),
            Format::Json | Format::Text => String::new(),
        };
        let json = ZoneReport::begin(ZoneForm {
            trees,
            quantiles: &options.quantiles,
            attributes: options.attribute.as_deref(),
            has_layers: trees.len() != 1,
            numbers: JsonNumbers::Plain,
        });
        Report { trees, options, format, next: 0, text, json }
    }

    /// Prints the remaining text.
    pub(super) fn finish(&mut self) -> Result<()> {
        if matches!(self.format, Format::Json) {
            self.json.finish();
        }
        self.print()
    }

    fn print(&mut self) -> Result<()> {
        match self.format {
            Format::Json => print_text(&self.json.take())?,
            Format::Text | Format::Csv => print_text(&self.text)?,
        }
        self.text.clear();
        Ok(())
    }

    /// Adds the statistics of the layer's feature with index `number`, for all layers of the tree.
    pub(super) fn add(
        &mut self,
        layer: &PolygonLayer,
        number: usize,
        zones: &[ZoneStatistics],
    ) -> Result<()> {
        let feature = &layer.features[number];
        self.next += 1;
        let name = layer.name(feature).unwrap_or_else(|| format!("#{}", self.next));
        let layers = || self.trees.iter().copied().zip(zones);
        match self.format {
            Format::Json => self.json.add(layer, number, zones),
            Format::Text => {
                for (tree, zone) in layers() {
                    let Metadata { name: own, time, .. } = tree.metadata();
                    let time = time.as_ref().map(|time| format!("  {time}")).unwrap_or_default();
                    let heading =
                        if zones.len() == 1 { name.clone() } else { format!("{name}  {own}{time}") };
                    write_zone(&mut self.text, tree, &heading, zone, self.options)?;
                }
            }
            Format::Csv => {
                let attribute = |name: &String| layer.value(feature, name).to_text();
                let attributes = self.options.attribute.iter().flatten().map(attribute);
                let id = feature.id.as_ref().map(text_of).unwrap_or_default();
                let first: Vec<String> = [name, id].into_iter().chain(attributes).collect();
                for (tree, zone) in layers() {
                    write_rows(&mut self.text, &first, (tree, zone), self.options);
                }
            }
        }
        if self.text.len().max(self.json.held()) > MAX_TEXT { self.print() } else { Ok(()) }
    }
}

/// Returns the first line of a table.
fn csv_heading(trees: &[&Dataset], options: &ZoneOptions) -> String {
    let more: Vec<String> = more_measures(options)
        .map(|measure| measure.name().into())
        .chain(options.quantiles.iter().copied().map(quantile_name))
        .collect();
    let attributes = options.attribute.iter().flatten().map(String::as_str);
    let before = ["zone", "id"].into_iter().chain(attributes);
    // (Layers of a file are all quadtrees, or all octrees.)
    let measure = trees.first().map_or(AREA, |tree| measure_key(tree));
    let own = COLUMNS.into_iter().filter(|name| has_column(name, options));
    let own = own.map(|name| if name == AREA { measure } else { name });
    let columns: Vec<&str> = before.chain(own).chain(more.iter().map(String::as_str)).collect();
    row_of(&columns)
}

/// Returns whether text and tables have a measure: a requested one; by default, one that is known
/// without reading all cells. Sums are printed on request only.
fn is_wanted(measure: ZoneMeasure, options: &ZoneOptions) -> bool {
    use ZoneMeasure::{Majority, Median, Minority, Sum, Variety};
    match options.measures.is_empty() {
        true => !matches!(measure, Majority | Median | Minority | Sum | Variety),
        false => options.measures.contains(&measure),
    }
}

/// Returns whether a table has one of [`COLUMNS`].
fn has_column(name: &str, options: &ZoneOptions) -> bool {
    use ZoneMeasure::{Classes, Count, Deviation, Max, Mean, Min, Void};
    let wanted = |measure| is_wanted(measure, options);
    match name {
        "class" | "class_name" => wanted(Classes),
        "cells" | AREA => wanted(Count) || wanted(Classes),
        "void_cells" => wanted(Void),
        "min" => wanted(Min),
        "max" => wanted(Max),
        "mean" => wanted(Mean),
        "standard_deviation" => wanted(Deviation),
        _ => true,
    }
}

/// Returns the requested measures that have no standard columns.
fn more_measures(options: &ZoneOptions) -> impl Iterator<Item = ZoneMeasure> {
    use ZoneMeasure::{Classes, Count, Deviation, Max, Mean, Min, Void};
    let is_there =
        |measure: &ZoneMeasure| matches!(measure, Count | Void | Min | Max | Mean | Deviation | Classes);
    options.measures.iter().copied().filter(move |measure| !is_there(measure))
}

/// The column of areas, or in octrees of volumes.
const AREA: &str = "area_m2";

/// Columns of a table, after those of the feature.
const COLUMNS: [&str; 12] = [
    "layer",
    "time",
    "channel",
    "class",
    "cells",
    "void_cells",
    AREA,
    "min",
    "max",
    "mean",
    "standard_deviation",
    "class_name",
];

/// Returns the fields of a channel at the end of a row.
fn more_of(zone: &ZoneStatistics, channel: usize, options: &ZoneOptions) -> Vec<String> {
    let number = |number: Option<Number>| number.map(|number| number.to_string()).unwrap_or_default();
    let values = zone.channels.get(channel).and_then(|channel| channel.values.as_ref());
    let quantile =
        |index: usize| values.map(|values| values.quantiles[index]).filter(|quantile| !quantile.is_nan());
    let measures = more_measures(options).map(|measure| number(zone.number(measure, channel)));
    let quantiles = (0..options.quantiles.len()).map(|index| number(quantile(index).map(Number::from)));
    measures.chain(quantiles).collect()
}

/// Writes table rows: one per channel, or per class if classes are counted and wanted. Without
/// cells it is one row without numbers.
fn write_rows(
    text: &mut String,
    first: &[String],
    (tree, zone): (&Dataset, &ZoneStatistics),
    options: &ZoneOptions,
) {
    let Metadata { name, time, .. } = tree.metadata();
    let measure = CellMeasure::of(tree).ok();
    let area_of =
        |cells: f64| measure.as_ref().map(|own| (own.of_cell * cells).to_string()).unwrap_or_default();
    let number = |number: f64| if number.is_nan() { String::new() } else { number.to_string() };
    let mut write = |index: usize, own: [String; 10]| {
        let layer = [name.clone(), time.clone().unwrap_or_default()];
        let more = more_of(zone, index, options);
        let columns = COLUMNS.iter().zip(layer.iter().chain(&own));
        let own = columns.filter(|(name, _)| has_column(name, options)).map(|(_, field)| field);
        let fields = first.iter().chain(own).chain(&more);
        let fields: Vec<&str> = fields.map(String::as_str).collect();
        text.push_str(&row_of(&fields));
    };
    let none = String::new;
    let void = number(zone.void_cells);
    if is_wanted(ZoneMeasure::Classes, options) && !zone.classes.is_empty() {
        for (value, cells) in &zone.classes {
            let class = class_name(tree, *value).unwrap_or_default().to_string();
            let (value, cells, area) = (value.to_string(), number(*cells), area_of(*cells));
            write(0, [none(), value, cells, void.clone(), area, none(), none(), none(), none(), class]);
        }
        return;
    }
    for (index, channel) in zone.channels.iter().enumerate() {
        let ZoneChannel { cells, min, max, mean, standard_deviation, .. } = channel;
        let extreme = |extreme: &Number| if extreme.to_f64().is_nan() { none() } else { extreme.to_string() };
        let numbers = [extreme(min), extreme(max), number(*mean), number(*standard_deviation)];
        let [min, max, mean, deviation] = numbers;
        let solid = measure.as_ref().map_or(*cells, |own| own.filled(*cells, Some(channel.mean)));
        let (channel, area) = ((index + 1).to_string(), area_of(solid));
        write(
            index,
            [channel, none(), number(*cells), void.clone(), area, min, max, mean, deviation, none()],
        );
    }
    if zone.channels.is_empty() {
        let (cells, area) = (number(zone.cells), area_of(zone.cells));
        write(0, [none(), none(), cells, void, area, none(), none(), none(), none(), none()]);
    }
}

/// Formats an id.
fn text_of(value: &serde_json::Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

fn write_zone(
    text: &mut String,
    tree: &Dataset,
    name: &str,
    zone: &ZoneStatistics,
    options: &ZoneOptions,
) -> Result<()> {
    use ZoneMeasure::{Classes, Count, Outside, Void, VoidShare};
    let wanted = |measure| is_wanted(measure, options);
    let measure = CellMeasure::of(tree).ok().filter(|measure| measure.unit != "cells");
    let mut counts = Vec::new();
    if wanted(Count) {
        counts.push(format!("{} cells", rounded(zone.cells)));
    }
    if wanted(Void) || wanted(VoidShare) {
        let and = if counts.is_empty() { "" } else { "and " };
        let share = match zone.void_cells > 0.0 {
            true => format!(" ({:.4} %)", 100.0 * zone.void_share()),
            false => String::new(),
        };
        counts.push(format!("{and}{} VOID{share}", rounded(zone.void_cells)));
    }
    if wanted(Outside) && (zone.outside_cells > 0.0 || !options.measures.is_empty()) {
        counts.push(format!("{} outside", rounded(zone.outside_cells)));
    }
    let mean = zone.channels.first().map(|channel| channel.mean);
    let measured = measure.as_ref().filter(|_| wanted(Count));
    let area = measured.map(|measure| measure.text(measure.filled(zone.cells, mean)));
    let heading = [Some(name.to_string()), Some(counts.join(", ")).filter(|text| !text.is_empty()), area];
    writeln!(text, "{}", heading.into_iter().flatten().collect::<Vec<_>>().join("  "))?;
    for (value, cells) in zone.classes.iter().filter(|_| wanted(Classes)) {
        let share = 100.0 * cells / zone.cells;
        write!(text, "{value:>8} {:>14} cells {share:>8.4} %", rounded(*cells))?;
        if let Some(measure) = &measure {
            write!(text, " {:>19}", measure.text(*cells))?;
        }
        writeln!(text, "  {}", class_name(tree, *value).unwrap_or_default())?;
    }
    for (index, channel) in zone.channels.iter().enumerate() {
        let numbers = numbers_of(channel, zone, options);
        if !numbers.is_empty() {
            writeln!(text, "  channel {}  {}", index + 1, numbers.join("  "))?;
        }
    }
    Ok(())
}

/// Returns the numbers of a channel with their names. Those of class numbers are printed on request
/// only.
fn numbers_of(channel: &ZoneChannel, zone: &ZoneStatistics, options: &ZoneOptions) -> Vec<String> {
    use ZoneMeasure::{Deviation, Majority, Max, Mean, Median, Min, Minority, Sum, Variety};
    let ZoneChannel { min, max, sum, mean, standard_deviation, values, .. } = channel;
    let is_default = zone.classes.is_empty() || !options.measures.is_empty();
    let mut numbers = Vec::new();
    let mut add = |measure, text: String| {
        if is_default && is_wanted(measure, options) {
            numbers.push(text);
        }
    };
    add(Min, format!("min {min}"));
    add(Max, format!("max {max}"));
    add(Mean, format!("mean {mean:.6}"));
    add(Deviation, format!("standard deviation {standard_deviation:.6}"));
    add(Sum, format!("sum {sum}"));
    if let Some(values) = values {
        add(Majority, format!("majority {}", values.majority));
        add(Minority, format!("minority {}", values.minority));
        add(Variety, format!("variety {}", values.variety));
        add(Median, format!("median {}", values.median));
        let quantiles = options.quantiles.iter().zip(&values.quantiles);
        numbers.extend(quantiles.map(|(at, quantile)| format!("quantile {at} {quantile}")));
    }
    numbers
}

/// Formats a number of cells, which may be fractional.
fn rounded(cells: f64) -> String {
    if cells.fract() == 0.0 { format!("{cells:.0}") } else { format!("{cells:.3}") }
}
