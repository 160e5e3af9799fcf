//! STL, binary.

use std::io::Write;

use glam::DVec3;

use super::sink::{Sink, Spill, Vertex, failed};
use spinney_base::io::Output;
use spinney_base::{Error, Result};

/// STL output. The header has the number of triangles, so these are buffered in a temporary file.
pub(super) struct Stl {
    output: Output,
    triangles: u64,
    spill: Spill,
}

impl Stl {
    pub(super) fn new(output: Output) -> Result<Stl> {
        let spill = Spill::new(&output)?;
        Ok(Stl { output, triangles: 0, spill })
    }
}

impl Sink for Stl {
    fn vertex(&mut self, _: [f64; 3]) -> Result<()> {
        Ok(())
    }

    fn face(&mut self, corners: &[Vertex], _: u32) -> Result<()> {
        let [a, b, c] = corners else { unreachable!("faces come as triangles") };
        if self.triangles == u64::from(u32::MAX) {
            let advice = "write PLY or OBJ, a coarser level, or parts of the tree (--view window=...)";
            let found = "an STL file of more than 2^32 triangles";
            return Err(Error::unsupported(self.output.path(), found, advice));
        }
        self.triangles += 1;
        // Normal of the triangle after rounding to single precision.
        let [a, b, c] = [a, b, c].map(|corner| corner.at.map(|number| number as f32));
        let to = |corner: [f32; 3]| DVec3::from(corner.map(f64::from)) - DVec3::from(a.map(f64::from));
        let normal = to(b).cross(to(c)).normalize_or_zero().to_array().map(|number| number as f32);
        let mut bytes = [0; 50];
        let numbers = [normal, a, b, c];
        for (field, number) in bytes.chunks_exact_mut(4).zip(numbers.as_flattened()) {
            field.copy_from_slice(&number.to_le_bytes());
        }
        self.spill.write(&bytes)
    }

    fn finish(self: Box<Self>) -> Result<()> {
        let Stl { mut output, triangles, spill } = *self;
        // The header must not begin with `solid`, which marks the text format.
        let mut header = [b' '; 84];
        header[..15].copy_from_slice(b"made by spinney");
        header[80..].copy_from_slice(&(triangles as u32).to_le_bytes());
        let path = output.path().to_path_buf();
        output.write_all(&header).map_err(failed(&path))?;
        spill.copy_to(&mut output)?;
        output.commit()
    }
}
