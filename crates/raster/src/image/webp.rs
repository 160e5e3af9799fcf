//! Writer of lossless WebP: painted images, or `u8` samples that are colours.

use std::io::Write as _;

use image::ExtendedColorType;
use image::codecs::webp::WebPEncoder;

use super::{ImageSpec, RowWriter, Rows};
use spinney_base::io::Output;
use spinney_base::value::SampleType;
use spinney_base::{Error, Result};

/// An image that is collected as a whole, since the encoder needs all of it.
struct Webp {
    output: Output,
    rows: Rows,
    size: [u32; 2],
    colours: ExtendedColorType,
    pixels: Vec<u8>,
}

/// Maximum number of columns or rows.
const LONGEST: u64 = 1 << 14;

pub(super) fn create(output: Output, spec: &ImageSpec) -> Result<Box<dyn RowWriter>> {
    let refused = |found: String, advice: &str| Err(Error::unsupported(output.path(), found, advice));
    if spec.value.sample != SampleType::U8 || spec.void {
        let found = format!("WebP with {} samples, or VOID pixels,", spec.value.sample.name());
        return refused(found, "give a style, or write .png, .tif or .npy");
    }
    if spec.width > LONGEST || spec.height > LONGEST {
        return refused(format!("WebP of more than {LONGEST} columns or rows"), "write .png or .tif");
    }
    let colours = match spec.value.channels {
        1 => ExtendedColorType::L8,
        2 => ExtendedColorType::La8,
        3 => ExtendedColorType::Rgb8,
        _ => ExtendedColorType::Rgba8,
    };
    let size = [spec.width as u32, spec.height as u32];
    Ok(Box::new(Webp { output, rows: Rows::new(spec), size, colours, pixels: Vec::new() }))
}

impl RowWriter for Webp {
    fn write_rows(&mut self, bytes: &[u8], _: Option<&[bool]>) -> Result<()> {
        self.rows.take(bytes)?;
        self.pixels.extend_from_slice(bytes);
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        self.rows.finish()?;
        let Webp { mut output, size: [width, height], colours, pixels, .. } = *self;
        let mut bytes = Vec::new();
        let encoded = WebPEncoder::new_lossless(&mut bytes).encode(&pixels, width, height, colours);
        let cause = encoded.map_err(std::io::Error::other).and_then(|()| output.write_all(&bytes));
        cause.map_err(Error::io(output.path(), "write"))?;
        output.commit()
    }
}
