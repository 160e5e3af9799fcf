//! Points in coordinate systems: reads lines of a system (its number or its definition), a
//! longitude and a latitude (degrees, WGS 84), and prints the projected coordinates, and their
//! longitude and latitude.
//!
//! ```sh
//! echo 'EPSG:3035 10 52' | cargo run --example project
//! echo '+proj=laea +lat_0=52 +lon_0=10 +datum=WGS84 10 52' | cargo run --example project
//! ```
//!
//! Alternatively reads lines of systems, and prints each in another form: `--as wkt2`, `--as esri`,
//! or `--as keys` (WKT 2 of its GeoTIFF keys).

use std::io::{self, BufRead, Write};

use spinney::Crs;
use spinney::raw::space::Projection;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<_> = std::env::args().collect();
    let allow_ballpark = arguments.iter().any(|argument| argument == "--allow-ballpark");
    if let Some([_, form]) = arguments.windows(2).find(|two| two[0] == "--as") {
        return write_as(form);
    }
    let mut open: Option<(String, spinney::Result<Projection>)> = None;
    let mut out = io::stdout().lock();
    for line in io::stdin().lock().lines() {
        let line = line?;
        let mut words = line.trim_end().rsplitn(3, char::is_whitespace);
        let (Some(latitude), Some(longitude), Some(name)) = (words.next(), words.next(), words.next()) else {
            return Err(format!(
                "{line}: expected a coordinate reference system, a longitude and a latitude"
            )
            .into());
        };
        let place = [longitude.parse()?, latitude.parse()?];
        let (_, projection) = match &open {
            Some(open) if open.0 == name => open,
            _ => {
                let projection = Crs::parse(name).and_then(|crs| Projection::new(&crs, allow_ballpark));
                open.insert((name.into(), projection))
            }
        };
        match projection {
            Err(error) => writeln!(out, "{}", error.to_string().replace('\n', " "))?,
            Ok(projection) => match projection.forward(place) {
                None => writeln!(out, "nowhere")?,
                Some(point) => {
                    let back = projection.inverse(point).unwrap_or([f64::NAN; 2]);
                    writeln!(out, "{:?} {:?} {:?} {:?}", point[0], point[1], back[0], back[1])?;
                }
            },
        }
    }
    Ok(())
}

/// Prints systems in another form.
fn write_as(form: &str) -> Result<(), Box<dyn std::error::Error>> {
    let write: fn(&Crs) -> spinney::Result<String> = match form {
        "wkt2" => Crs::to_wkt2,
        "esri" => Crs::to_esri_wkt,
        "keys" => |crs| Crs::GeoKeys(crs.to_geo_keys()?).to_wkt2(),
        other => return Err(format!("--as {other}: expected wkt2, esri or keys").into()),
    };
    let mut out = io::stdout().lock();
    for line in io::stdin().lock().lines() {
        match Crs::parse(&line?).and_then(|crs| write(&crs)) {
            Ok(text) => writeln!(out, "{text}")?,
            Err(error) => writeln!(out, "error: {}", error.to_string().replace('\n', " "))?,
        }
    }
    Ok(())
}
