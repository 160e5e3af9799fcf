//! Places in coordinate systems: reads lines of a system (by its number or its definition), a longitude and a latitude (degrees, WGS 84), and
//! prints the coordinates there, and the longitude and latitude that these are.
//!
//! ```sh
//! echo 'EPSG:3035 10 52' | cargo run --example project
//! echo '+proj=laea +lat_0=52 +lon_0=10 +datum=WGS84 10 52' | cargo run --example project
//! ```

use std::io::{self, BufRead, Write};

use spinney::space::{Crs, Projection};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let allow_ballpark = std::env::args().any(|argument| argument == "--allow-ballpark");
    let mut open: Option<(String, spinney::Result<Projection>)> = None;
    let mut out = io::stdout().lock();
    for line in io::stdin().lock().lines() {
        let line = line?;
        let mut words = line.trim_end().rsplitn(3, char::is_whitespace);
        let (Some(latitude), Some(longitude), Some(name)) = (words.next(), words.next(), words.next()) else {
            return Err(format!("{line}: expected a system, a longitude and a latitude").into());
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
