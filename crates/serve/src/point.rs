//! `/point/NAME`: the samples of one cell in all layers.

use spinney_crs::Coordinates;
use spinney_report::PointLayers;

use crate::failure::Failure;
use crate::opened::OpenTree;
use crate::parameters::Parameters;
use crate::response::QueryResponse;

/// Parameters of the query.
pub(crate) const PARAMETERS: [&str; 7] = ["x", "y", "z", "crs", "level", "layer", "commit"];

/// Response with the same content as `spinney point --json`.
pub(crate) fn respond(
    tree: &OpenTree,
    parameters: &Parameters,
    tag: String,
) -> Result<QueryResponse, Failure> {
    let coordinates = parameters.value("crs")?.unwrap_or(Coordinates::World);
    let trees = tree.layers(parameters.text("layer"))?;
    let layers = PointLayers::new(&trees, &coordinates, parameters.value("level")?)?;
    let needed = |name: &str| {
        parameters
            .number(name)?
            .ok_or_else(|| Failure::bad(format!("{name}: is missing; a point has x and y, and in octrees z")))
    };
    let z = if layers.axes() == 3 { needed("z")? } else { parameters.number("z")?.unwrap_or(0.0) };
    let cells = [layers.cell([needed("x")?, needed("y")?, z])];
    let mut text = Vec::new();
    layers.query(&cells)?.write_json(&layers.headings(), 0, &mut text);
    Ok(QueryResponse::new("application/json", tag, text))
}
