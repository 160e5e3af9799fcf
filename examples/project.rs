//! Places in coordinate systems: reads lines of a system, a longitude and a latitude (degrees, WGS 84), and prints the coordinates there, and
//! the longitude and latitude that these are.
//!
//! ```sh
//! echo 'EPSG:3035 10 52' | cargo run --example project
//! ```

use std::io::{self, BufRead, Write};

use spinney::space::{Crs, Projection};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let allow_ballpark = std::env::args().any(|argument| argument == "--allow-ballpark");
    let mut open: Option<(String, spinney::Result<Projection>)> = None;
    let mut out = io::stdout().lock();
    for line in io::stdin().lock().lines() {
        let line = line?;
        let mut words = line.split_whitespace();
        let (Some(name), Some(longitude), Some(latitude)) = (words.next(), words.next(), words.next()) else {
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
            Err(error) => writeln!(out, "{error}")?,
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
