//! `spinney build`

use std::path::PathBuf;
use std::time::Instant;

use anyhow::bail;
use spinney::import::mesh;
use spinney::import::raster::{self, ImportOptions};
use spinney::io::Output;
use spinney::store::file_is_tree;
use spinney::value::{Kind, Rule};

use super::output::{check_output, tell_output_of};
use super::progress::Work;
use super::{Global, Result, model, quantity};

/// Make a tree of a picture, or of several on one grid, or of models of solids.
///
/// Reads TIFF and GeoTIFF, PNG, JPEG, WebP, OpenEXR and SRTM .hgt files of any size and writes one file that holds them at
/// every level of detail: a .goblin file, compact and read-only, or an .autumn file, which can be edited. What the files say about their pixels (coordinates, nodata, palette, names)
/// is kept; options overrule it.
///
/// Reads models of solids, too: PLY, OBJ, STL, OFF, CityJSON and CityJSONSeq. What their surface encloses becomes an
/// octree, exactly where the surface is closed, also with overlapping bodies and cavities, and by its winding field where
/// it is not. Several models become one solid.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Raster files (of several, the last lies on top), or models
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// The file to make; - is standard output
    #[arg(short, long, value_name = "OUT.goblin")]
    output: PathBuf,
    /// What the values mean: categorical (classes, counted) or continuous (amounts, averaged) [default: from the
    /// file]
    #[arg(long)]
    kind: Option<Kind>,
    /// The value that stands for many at coarse detail: mean, majority, dominant, min, max or nearest [default:
    /// mean of amounts, majority of classes]
    #[arg(long)]
    rule: Option<Rule>,
    /// Channels to take, counted from 1, in this order [default: all]
    #[arg(long, value_name = "N,...", value_delimiter = ',')]
    band: Option<Vec<usize>>,
    /// The number that means nothing is there [default: from the file]
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true)]
    nodata: Option<f64>,
    /// Levels of the tree; its space has 2^N cells along a side [default: as few as hold the picture]
    #[arg(long, value_name = "N")]
    depth: Option<u8>,
    /// Coordinate system of the pixels, by its EPSG number [default: from the file]
    #[arg(long, value_name = "NUMBER")]
    epsg: Option<u32>,
    /// Where the pixels lie: x = a col + b row + c, y = d col + e row + f [default: from the file]
    #[arg(long, value_name = "a,b,c,d,e,f", value_parser = parse_transform, allow_hyphen_values = true)]
    transform: Option<[f64; 6]>,
    /// Layer of an OpenEXR file, by name [default: the first]
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Memory to use, such as 256M or 2G; what does not fit goes to a temporary file beside the output
    #[arg(long, value_name = "BYTES", default_value = "256M", value_parser = quantity::parse_bytes)]
    memory: u64,
    /// Store equal subtrees once; for .autumn files
    #[arg(long)]
    share: bool,
    #[command(flatten)]
    model: model::Model,
}

const EXAMPLES: &str = "\
Examples:
  spinney build world.tif -o world.goblin
  spinney build landcover.tif -o landcover.goblin --kind categorical --nodata 0
  spinney build scene.tif -o colour.goblin --band 4,3,2
  spinney build N46E007.hgt N46E008.hgt -o alps.goblin --memory 1G
  spinney build scan.png -o scan.goblin --epsg 3857 --transform 0.5,0,1000,0,-0.5,2000
  spinney build bunny.ply -o bunny.goblin --cells 1024
  spinney build part.stl -o part.goblin --cell 0.1mm --unit mm --boundary coverage
  spinney build city.json -o city.goblin --cell 0.5 --attribute part
  spinney build landcover.tif -o landcover.autumn --share
  spinney build world.tif -o - | ssh host 'cat > world.goblin'

The output appears under its name only when it is complete; until then, an older file of that name stays.";

pub(crate) fn run(args: Args, global: &Global) -> Result {
    let start = Instant::now();
    check_output(args.inputs.iter().map(PathBuf::as_path), &args.output)?;
    if let Some(tree) = args.inputs.iter().find(|input| file_is_tree(input)) {
        let tree = tree.display();
        bail!("{tree}: is a tree already; `spinney publish {tree} OUT` writes it in either format");
    }
    let Args {
        inputs,
        output: path,
        kind,
        rule,
        band: bands,
        nodata,
        depth,
        epsg,
        transform,
        layer,
        memory,
        share,
        model: solid,
    } = args;
    if inputs.iter().any(|input| mesh::is_model(input)) {
        let is_for_pictures = kind.is_some()
            || rule.is_some()
            || bands.is_some()
            || nodata.is_some()
            || transform.is_some()
            || layer.is_some();
        if is_for_pictures {
            bail!(
                "--kind, --rule, --band, --nodata, --transform and --layer are for pictures, not for models"
            );
        }
        return model::build(&inputs, &path, &solid, (depth, epsg, memory, share), global);
    }
    if solid.is_given() {
        bail!(
            "{}: is no model; the options for solids are for PLY, OBJ, STL, OFF and CityJSON files",
            inputs[0].display()
        );
    }
    let memory = Some(memory);
    let options = ImportOptions { kind, rule, bands, nodata, depth, epsg, transform, layer, memory, share };
    let import = raster::plan(&inputs, &options)?;
    for (heading, text) in import.description() {
        global.say(format_args!("{heading:<10} {text}"));
    }
    let raw = import.raw_bytes();
    // Ears before hands: no moment in which Ctrl-C would leave a temporary file.
    let work = Work::start(global, "cells")?;
    let output = Output::create(&path)?;
    import.build(output, &work)?;
    work.finish();
    tell_output_of(global, &path, start, Some(raw));
    Ok(())
}

fn parse_transform(text: &str) -> Result<[f64; 6], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse()).collect();
    numbers.ok().and_then(|numbers| numbers.try_into().ok()).ok_or("expected six numbers: a,b,c,d,e,f".into())
}
