//! A volume of raw samples as an octree: `cargo run --release --example volume -- RAW WIDTH HEIGHT DEPTH OUT.goblin`
//!
//! RAW has little-endian f32, x running fastest, then y, then z; NaN is VOID. Samples come slab by slab, so that memory does not go with
//! the volume. The surface of a value is then `spinney contours OUT.goblin --levels 0.5 -o surface.ply`.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use spinney::io::Output;
use spinney::space::Dimension;
use spinney::store::{BuildOptions, Slab, Slabs, build_slabs, depth_for};
use spinney::tree::Form;
use spinney::value::{Kind, SampleType, ValueType};
use spinney::{Error, Result};

/// Octrees of f32.
const FORM: Form = Form::new(Dimension::Oct, ValueType::new(SampleType::F32, 1));

/// Planes of a slab: the side of the blocks that octrees are built of.
const PLANES: u64 = 64;

struct RawVolume {
    path: PathBuf,
    file: File,
    size: [u64; 3],
    plane: u64,
}

impl Slabs for RawVolume {
    fn extent(&self) -> [u64; 3] {
        self.size
    }

    fn next(&mut self, slab: &mut Slab) -> Result<bool> {
        let [width, height, depth] = self.size;
        let planes = PLANES.min(depth - self.plane);
        (slab.origin, slab.size) = ([0, 0, self.plane], [width, height, planes]);
        slab.bytes.resize((width * height * planes * 4) as usize, 0);
        self.file.read_exact(&mut slab.bytes).map_err(Error::io(&self.path, "read"))?;
        let is_number = |bytes: &[u8]| !f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]).is_nan();
        let valid: Vec<bool> = slab.bytes.chunks_exact(4).map(is_number).collect();
        slab.valid = valid.contains(&false).then_some(valid);
        self.plane += planes;
        Ok(planes > 0)
    }
}

fn main() -> std::result::Result<(), Box<dyn std::error::Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [raw, width, height, depth, out] = &words[..] else {
        return Err("expected RAW WIDTH HEIGHT DEPTH OUT.goblin".into());
    };
    let size = [width.parse()?, height.parse()?, depth.parse()?];
    let mut volume = RawVolume { path: raw.into(), file: File::open(raw)?, size, plane: 0 };
    let options = BuildOptions::new(Kind::Continuous, depth_for(size));
    build_slabs(FORM, &mut volume, None, &options, Output::create(Path::new(out))?, &())?;
    Ok(())
}
