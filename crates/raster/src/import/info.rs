//! Checks and defaults that most readers share.

use std::collections::BTreeMap;
use std::path::Path;

use super::{Order, RasterInfo, RasterOptions, Transparent};
use spinney_base::space::Region;
use spinney_base::value::SampleType;
use spinney_base::{Error, Result};
use spinney_crs::Frame;

impl RasterInfo {
    /// A raster without further properties.
    pub(crate) fn plain(size: [u64; 2], sample: SampleType, channels: usize) -> RasterInfo {
        RasterInfo {
            width: size[0],
            height: size[1],
            sample,
            stored_sample: sample.name().into(),
            channels,
            alpha: None,
            transparent: Transparent::Void,
            bands: Vec::new(),
            frame: Frame::identity(),
            nodata: None,
            palette: None,
            colour_roles: vec![String::new(); channels],
            class_names: Vec::new(),
            class_channel: 0,
            band_names: vec![String::new(); channels],
            scale_offset: vec![(1.0, 0.0); channels],
            units: vec![String::new(); channels],
            kind: None,
            layout: String::new(),
            tags: BTreeMap::new(),
            scoped_tags: BTreeMap::new(),
            control_points: None,
            remark: None,
            pages: 1,
            order: Order::Anywhere,
        }
    }

    /// Drops properties that do not affect samples.
    pub(super) fn forget(&mut self) {
        let RasterInfo { sample, channels, alpha, order, .. } = *self;
        let bands = std::mem::take(&mut self.bands).into_iter();
        let bands =
            bands.map(|band| super::BandInfo { palette: None, class_names: Vec::new(), ..band }).collect();
        *self = RasterInfo {
            alpha,
            order,
            bands,
            ..RasterInfo::plain([self.width, self.height], sample, channels)
        };
    }

    /// Assigns colour roles: red, green and blue if there are three channels, and opacity.
    pub(super) fn in_colour(mut self) -> RasterInfo {
        if self.channels >= 3 {
            let role = |channel| match channel {
                channel if self.alpha == Some(channel) => "Alpha",
                0..=2 => ["Red", "Green", "Blue"][channel],
                _ => "Undefined",
            };
            self.colour_roles = (0..self.channels).map(|channel| role(channel).into()).collect();
        }
        self
    }

    /// Bytes of one pixel as returned by [`super::Raster::read`].
    pub(super) fn pixel_bytes(&self) -> usize {
        self.sample.size() * self.channels
    }

    /// Fails if a region is not within the raster.
    pub(crate) fn check(&self, region: Region) -> Result<()> {
        if Region::new(0, 0, self.width, self.height).contains(&region) {
            return Ok(());
        }
        let size = format!("a region within {} x {} pixels", self.width, self.height);
        Err(Error::invalid("region to read", format!("{region:?}"), size))
    }
}

impl RasterOptions {
    /// Fails if `needed` bytes for `what` exceed the memory budget.
    pub(crate) fn check_memory(&self, path: &Path, what: &str, needed: u64) -> Result<()> {
        if needed <= self.memory {
            return Ok(());
        }
        Err(Error::TooLarge {
            path: path.to_path_buf(),
            what: what.into(),
            needed,
            limit: self.memory,
            advice: "allow more with --memory, or convert the file to tiled TIFF".into(),
        })
    }
}
