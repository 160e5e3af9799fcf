//! Exact statistics of any box, from zone statistics where a zone lies inside and from the tree where it is cut.

/// Statistics of the cells of a box that are not VOID.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Cells that are not VOID.
    pub cells: u64,
    /// Cells of the box within the picture that are VOID.
    pub void_cells: u64,
    /// Smallest sample, largest sample, mean and standard deviation (of the population) of each channel.
    pub channels: Vec<ChannelStatistics>,
    /// Cells of each value, by ascending value; only for one-channel files that count classes.
    pub classes: Vec<(f64, u64)>,
    /// Segments whose records had to be read.
    pub segments_read: u64,
}

/// Statistics of one channel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[allow(missing_docs)] // the names say it
pub struct ChannelStatistics {
    pub min: f64,
    pub max: f64,
    pub mean: f64,
    pub deviation: f64,
}
