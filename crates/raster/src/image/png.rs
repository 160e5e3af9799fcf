//! Writer of PNG.

use std::cell::RefCell;
use std::io::{self, Write};
use std::rc::Rc;

use png::{BitDepth, ColorType, Compression, Encoder, EncodingError, StreamWriter};

use super::{ImageSpec, RowWriter, Rows};
use spinney_base::io::Output;
use spinney_base::value::{Number, Palette, SampleType};
use spinney_base::{Error, Result};

struct Png {
    stream: StreamWriter<'static, Shared>,
    output: Shared,
    rows: Rows,
    /// Bytes of a sample and of a pixel in the input.
    sample: usize,
    pixel: usize,
    /// RGBA colours of the values, if the palette is expanded.
    colours: Option<[[u8; 4]; 256]>,
    opacity: Opacity,
    /// Pixels with opacity, big-endian.
    converted: Vec<u8>,
}

/// Representation of VOID.
#[derive(Clone, Copy, PartialEq)]
enum Opacity {
    /// Nothing is VOID, or a palette entry encodes it.
    None,
    /// An opacity channel that the values lack.
    Added,
    /// The values' own last channel is set to 0.
    Own,
}

/// The output, shared with the encoder, which takes ownership of its writer and never returns it.
#[derive(Clone)]
struct Shared {
    output: Rc<RefCell<Output>>,
    /// The I/O error of a failed write. The encoder keeps only its message.
    failure: Rc<RefCell<Option<io::Error>>>,
}

impl Shared {
    fn new(output: Output) -> Shared {
        Shared { output: Rc::new(RefCell::new(output)), failure: Rc::default() }
    }

    /// Keeps the error of a failed write.
    fn remember<T>(&self, result: io::Result<T>) -> io::Result<T> {
        result.map_err(|failure| {
            let kind = failure.kind();
            *self.failure.borrow_mut() = Some(failure);
            kind.into()
        })
    }

    fn error(&self, error: EncodingError) -> Error {
        let cause = self.failure.take().unwrap_or_else(|| match error {
            EncodingError::IoError(error) => error,
            other => io::Error::other(other),
        });
        Error::io(self.output.borrow().path(), "write")(cause)
    }
}

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.output.borrow_mut().write(bytes);
        self.remember(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        let flushed = self.output.borrow_mut().flush();
        self.remember(flushed)
    }
}

pub(super) fn create(output: Output, spec: &ImageSpec) -> Result<Box<dyn RowWriter>> {
    let depth = match spec.value.sample {
        SampleType::U8 => BitDepth::Eight,
        SampleType::U16 => BitDepth::Sixteen,
        other => {
            let advice = match other {
                SampleType::F32 | SampleType::U32 => "give a range to stretch, or write .tif, .npy or .exr",
                _ => "give a range to stretch, or write .tif or .npy",
            };
            return Err(Error::unsupported(
                output.path(),
                format!("PNG with {} samples", other.name()),
                advice,
            ));
        }
    };
    let (Ok(width), Ok(height)) = (i32::try_from(spec.width), i32::try_from(spec.height)) else {
        return Err(Error::unsupported(
            output.path(),
            "PNG with more than 2^31 - 1 rows or columns",
            "write .tif",
        ));
    };
    let palette =
        spec.metadata.palette.as_ref().filter(|_| depth == BitDepth::Eight && spec.value.channels == 1);
    // If no number is free for VOID, the colours themselves are written.
    let (palette, colours) = match palette {
        Some(palette) if spec.void && void_entry(spec.metadata.nodata).is_none() => {
            (None, Some(colours(palette)))
        }
        palette => (palette, None),
    };
    let own = if colours.is_some() { 4 } else { spec.value.channels };
    let opacity = match (spec.void && palette.is_none(), own % 2) {
        (false, _) => Opacity::None,
        (true, 1) => Opacity::Added,
        (true, _) => Opacity::Own,
    };
    let channels = own + u8::from(opacity == Opacity::Added);

    let output = Shared::new(output);
    let mut encoder = Encoder::new(output.clone(), width as u32, height as u32);
    encoder.set_depth(depth);
    encoder.set_color(match (palette, channels) {
        (Some(_), _) => ColorType::Indexed,
        (None, 1) => ColorType::Grayscale,
        (None, 2) => ColorType::GrayscaleAlpha,
        (None, 3) => ColorType::Rgb,
        (None, _) => ColorType::Rgba,
    });
    encoder.set_compression(Compression::Fast);
    if let Some(palette) = palette {
        let (colours, opacities) = palette_chunks(palette, spec.metadata.nodata);
        encoder.set_palette(colours);
        if !opacities.is_empty() {
            encoder.set_trns(opacities);
        }
    }
    let stream = encoder.write_header().and_then(|writer| writer.into_stream_writer());
    let stream = stream.map_err(|error| output.error(error))?;
    let (sample, pixel) = (spec.value.sample.size(), spec.value.size());
    let (rows, converted) = (Rows::new(spec), Vec::new());
    Ok(Box::new(Png { stream, output, rows, sample, pixel, colours, opacity, converted }))
}

/// Colours of all 256 values; opaque black where the palette has none.
fn colours(palette: &Palette) -> [[u8; 4]; 256] {
    let mut colours = [[0, 0, 0, 255]; 256];
    for (entry, colour) in colours.iter_mut().zip(&palette.colours) {
        *entry = *colour;
    }
    colours
}

/// The palette index for VOID, if its number is one.
fn void_entry(nodata: Option<Number>) -> Option<usize> {
    nodata?.to_integer().filter(|number| (0..256).contains(number)).map(|index| index as usize)
}

/// The PLTE and tRNS chunks. All 256 entries are written, because an index beyond the palette is an
/// error in a PNG file.
fn palette_chunks(palette: &Palette, nodata: Option<Number>) -> (Vec<u8>, Vec<u8>) {
    let mut colours = colours(palette);
    if let Some(index) = void_entry(nodata) {
        colours[index][3] = 0;
    }
    let opaque_from = colours.iter().rposition(|colour| colour[3] < 255).map_or(0, |last| last + 1);
    let plte = colours.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect();
    (plte, colours[..opaque_from].iter().map(|colour| colour[3]).collect())
}

impl Png {
    /// Fills `converted` with the pixels in PNG's layout.
    fn convert(&mut self, bytes: &[u8], valid: Option<&[bool]>) {
        let Png { sample, pixel, colours, opacity, converted, .. } = self;
        converted.clear();
        for (i, pixel) in bytes.chunks_exact(*pixel).enumerate() {
            let start = converted.len();
            match colours {
                Some(colours) => converted.extend_from_slice(&colours[usize::from(pixel[0])]),
                None => converted.extend_from_slice(pixel),
            }
            let alpha = if valid.is_none_or(|valid| valid[i]) { [255; 2] } else { [0; 2] };
            match opacity {
                Opacity::Added => converted.extend_from_slice(&alpha[..*sample]),
                Opacity::Own if alpha == [0; 2] => {
                    let end = converted.len();
                    converted[end - *sample..].fill(0);
                }
                _ => {}
            }
            if *sample == 2 {
                converted[start..].as_chunks_mut::<2>().0.iter_mut().for_each(|sample| sample.reverse());
            }
        }
    }
}

impl RowWriter for Png {
    fn write_rows(&mut self, bytes: &[u8], valid: Option<&[bool]>) -> Result<()> {
        let rows = self.rows.take(bytes)?;
        if self.sample == 1 && self.opacity == Opacity::None {
            return self.stream.write_all(bytes).map_err(|error| self.output.error(error.into()));
        }
        // Row by row, so that the converted copy stays small.
        let row_bytes = self.rows.row_bytes as usize;
        let width = row_bytes / self.pixel;
        for row in 0..rows as usize {
            self.convert(&bytes[row * row_bytes..][..row_bytes], valid.map(|v| &v[row * width..][..width]));
            self.stream.write_all(&self.converted).map_err(|error| self.output.error(error.into()))?;
        }
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        self.rows.finish()?;
        let Png { stream, output, .. } = *self;
        stream.finish().map_err(|error| output.error(error))?;
        match Rc::try_unwrap(output.output) {
            Ok(output) => output.into_inner().commit(),
            Err(_) => unreachable!("the encoder is dropped, so this is the only owner"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn palettes_have_colours_and_opacities() {
        let palette = Palette { colours: vec![[1, 2, 3, 255], [4, 5, 6, 128]] };
        let (colours, opacities) = palette_chunks(&palette, None);
        assert_eq!((colours.len(), &colours[..7]), (768, &[1, 2, 3, 4, 5, 6, 0][..]));
        assert_eq!(opacities, [255, 128]);
        assert_eq!(palette_chunks(&palette, Some(3.into())).1, [255, 128, 255, 0]);
        assert_eq!(palette_chunks(&palette, Some((-1).into())).1, [255, 128]);
    }
}
