//! `/zonal/NAME`: exact statistics of the cells in polygons.

use spinney_base::Progress;
use spinney_crs::Coordinates;
use spinney_engine::query::{ZonalRequest, ZoneMeasure};
use spinney_report::{JsonNumbers, ZoneForm, ZoneReport};
use spinney_vector::import::feature::FeatureOptions;
use spinney_vector::import::zones::PolygonReader;
use spinney_vector::zonal::FeatureZones;

use crate::failure::Failure;
use crate::opened::OpenTree;
use crate::parameters::Parameters;
use crate::response::QueryResponse;

/// Parameters of the query.
pub(crate) const PARAMETERS: [&str; 8] =
    ["edge", "measure", "quantiles", "where", "attribute", "crs", "layer", "commit"];

/// Memory limit in bytes, for each of: the values of zones, the features, and the response.
const MEMORY: u64 = 32 << 20;

/// Response with the same content as `spinney stats --zones --json` for a file with this GeoJSON.
pub(crate) fn respond(
    tree: &OpenTree,
    parameters: &Parameters,
    geojson: Vec<u8>,
    progress: &dyn Progress,
) -> Result<QueryResponse, Failure> {
    let trees = tree.layers(parameters.text("layer"))?;
    let coordinates: Option<Coordinates> = parameters.value("crs")?;
    let request = ZonalRequest {
        edge: parameters.value("edge")?.unwrap_or_default(),
        measures: parameters.list::<ZoneMeasure>("measure")?.unwrap_or_default(),
        quantiles: parameters.list("quantiles")?.unwrap_or_default(),
        memory: MEMORY,
    };
    let attributes: Option<Vec<String>> = parameters.list("attribute")?;
    let has_system = trees.iter().all(|tree| tree.metadata().frame.crs.is_some());
    let check_degrees = coordinates.is_none() && has_system;
    let mut options = FeatureOptions { memory: MEMORY, check_degrees, ..FeatureOptions::default() };
    options.attributes.clone_from(&attributes);
    options.filter = parameters.value("where")?.unwrap_or_default();
    let mut reader = PolygonReader::of_geojson(geojson, &options).map_err(of_body)?;
    let mut zones = FeatureZones::new(&reader, coordinates.as_ref(), &trees, &request, progress)?;
    let mut report = ZoneReport::begin(ZoneForm {
        trees: &trees,
        quantiles: &request.quantiles,
        attributes: attributes.as_deref(),
        has_layers: trees.len() != 1,
        numbers: JsonNumbers::Plain,
    });
    let mut is_too_long = false;
    while let Some(layer) = reader.next_layer().map_err(of_body)? {
        let walked = zones.each(&layer, progress, &mut |number, zone| {
            report.add(&layer, number, zone);
            is_too_long = report.held() as u64 > MEMORY;
            if is_too_long { Err(spinney_base::Error::Interrupted) } else { Ok(()) }
        });
        if is_too_long {
            let message =
                format!("response: is longer than {MEMORY} bytes; request fewer polygons at a time");
            return Err(Failure::too_large(message));
        }
        walked?;
    }
    zones.finish(progress)?;
    report.finish();
    Ok(QueryResponse::untagged("application/json", report.take().into_bytes()))
}

/// Failure caused by the polygons in the request: a client error.
fn of_body(error: spinney_base::Error) -> Failure {
    let failure = Failure::from(error);
    if failure.status.is_server_error() { Failure::bad(failure.message) } else { failure }
}
