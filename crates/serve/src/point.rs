//! `/point/NAME`: the samples of one cell in all layers.

use spinney_crs::Coordinates;
use spinney_report::PointLayers;

use crate::answer::Answer;
use crate::failure::Failure;
use crate::opened::OpenTree;
use crate::parameters::Parameters;

/// Parameters of the query.
pub(crate) const PARAMETERS: [&str; 7] = ["x", "y", "z", "crs", "level", "layer", "commit"];

/// Response with the same content as `spinney point --json`.
pub(crate) fn answer(tree: &OpenTree, asked: &Parameters, tag: String) -> Result<Answer, Failure> {
    let coordinates = asked.value("crs")?.unwrap_or(Coordinates::World);
    let trees = tree.layers(asked.text("layer"))?;
    let layers = PointLayers::new(&trees, &coordinates, asked.value("level")?)?;
    let needed = |name: &str| {
        asked.number(name)?.ok_or_else(|| {
            Failure::bad(format!("{name}: is missing; a point has x and y, of octrees also z"))
        })
    };
    let z = if layers.axes() == 3 { needed("z")? } else { asked.number("z")?.unwrap_or(0.0) };
    let cells = [layers.cell([needed("x")?, needed("y")?, z])];
    let mut text = Vec::new();
    layers.ask(&cells)?.write_json(&layers.headings(), 0, &mut text);
    Ok(Answer::new("application/json", tag, text))
}
