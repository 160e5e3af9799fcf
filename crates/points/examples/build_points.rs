use spinney_points::{BuildOptions, PointSource, build, las::LasReader};
use std::path::Path;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let start = std::time::Instant::now();
    let mut source = LasReader::open(Path::new(&args[1])).unwrap();
    println!("{:?} {:?}", source.schema().bounds, source.schema().crs);
    let memory = args.get(3).map_or(512, |text| text.parse().unwrap());
    let options = BuildOptions {
        memory: memory << 20,
        leaf_size: args.get(4).map_or(50_000, |text| text.parse().unwrap()),
    };
    let output = spinney_base::io::Output::create(Path::new(&args[2])).unwrap();
    let summary = build(&mut source, &options, &Default::default(), output, &()).unwrap();
    let length = std::fs::metadata(&args[2]).unwrap().len();
    println!(
        "{summary:?} {:?} {:.3} bits a point",
        start.elapsed(),
        length as f64 * 8.0 / summary.points as f64
    );
}
