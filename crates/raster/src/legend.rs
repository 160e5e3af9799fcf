//! Export of legends as PNG, SVG or JSON.

use std::io::Write as _;

use super::image::{Format, ImageSpec, create};
use spinney_base::io::Output;
use spinney_base::value::{SampleType, ValueType};
use spinney_base::{Error, Result};
use spinney_container::Metadata;
use spinney_style::Legend;

/// File format of a legend.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LegendFormat {
    /// An image, enlarged 1 to 8 times: see [`Legend::draw`].
    Png(usize),
    /// Vector graphics: lines and letters.
    Svg,
    /// Colours and labels, for programs.
    Json,
}

impl LegendFormat {
    /// Returns the format for a file name extension (`png`, `svg`, `json`), or `None` for any
    /// other. `scale` enlarges PNG images 1 to 8 times.
    pub fn named(ending: &str, scale: u8) -> Option<LegendFormat> {
        match ending.to_ascii_lowercase().as_str() {
            "png" => Some(LegendFormat::Png(scale.into())),
            "svg" => Some(LegendFormat::Svg),
            "json" => Some(LegendFormat::Json),
            _ => None,
        }
    }
}

/// Writes a legend.
///
/// # Errors
/// If the output cannot be written.
pub fn export_legend(legend: &Legend, mut output: Output, format: LegendFormat) -> Result<()> {
    let text = match format {
        LegendFormat::Svg => legend.svg(),
        LegendFormat::Json => legend.json() + "\n",
        LegendFormat::Png(dot) => {
            let image = legend.draw(dot);
            let spec = ImageSpec {
                width: image.width as u64,
                height: image.height as u64,
                value: ValueType::new(SampleType::U8, 4),
                alpha: true,
                void: false,
                metadata: Metadata::default(),
            };
            let mut writer = create(output, Format::Png, &spec)?;
            writer.write_rows(&image.rgba, None)?;
            return writer.finish();
        }
    };
    output.write_all(text.as_bytes()).map_err(Error::io(output.path(), "write"))?;
    output.commit()
}
