//! Queries by region, level and conditions.

use super::condition::PointCondition;
use super::region::{GridRegion, PointRegion};
use crate::attribute::{PointAttribute, bytes_of, to_f64};
use crate::grid::PointGrid;
use crate::statistics::Statistics;
use crate::store::{PointNode, PointTree};
use spinney_base::space::Cover;
use spinney_base::value::SampleType;
use spinney_base::{Progress, Result, parallel};

/// Selection of points.
#[derive(Clone, Debug)]
pub struct Selection {
    /// Region of the points.
    pub region: PointRegion,
    /// Deepest level to read; `None` for all.
    pub level: Option<u8>,
    /// Conditions on the attributes; all must hold.
    pub conditions: Vec<PointCondition>,
}

impl Default for Selection {
    fn default() -> Selection {
        Selection { region: PointRegion::All, level: None, conditions: Vec::new() }
    }
}

/// Points as columns: x, y and z on the grid, then the attributes. Columns of attributes that were
/// not requested are empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointColumns {
    pub(crate) columns: Vec<Vec<i64>>,
}

impl PointColumns {
    /// Returns the number of points.
    pub fn len(&self) -> usize {
        self.columns.first().map_or(0, Vec::len)
    }

    /// Returns whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the grid position of a point.
    #[inline]
    pub fn position(&self, point: usize) -> [i32; 3] {
        std::array::from_fn(|axis| self.columns[axis][point] as i32)
    }

    /// Appends one row per point, little-endian: world coordinates x, y and z as doubles, then the
    /// chosen attributes. An attribute has its own type, or is a double if it has scale and offset.
    /// Floating-point numbers that encode "no value" become NaN; integers without a scale are as
    /// stored.
    pub fn rows(
        &self,
        grid: &PointGrid,
        attributes: &[PointAttribute],
        chosen: &[usize],
        bytes: &mut Vec<u8>,
    ) {
        for point in 0..self.len() {
            let world = grid.to_world(self.position(point));
            world.iter().for_each(|number| bytes.extend_from_slice(&number.to_le_bytes()));
            for index in chosen {
                let attribute = &attributes[*index];
                let number = self.columns[3 + index][point];
                let is_missing = attribute.no_data == Some(number);
                match (attribute.scale_offset, attribute.sample) {
                    (None, SampleType::F32) if is_missing => bytes.extend_from_slice(&f32::NAN.to_le_bytes()),
                    (None, sample) if !is_missing || sample != SampleType::F64 => {
                        bytes.extend_from_slice(&bytes_of(sample, number)[..sample.size()]);
                    }
                    _ => bytes.extend_from_slice(&attribute.quantity(number).to_le_bytes()),
                }
            }
        }
    }

    /// Returns the quantity of a point's attribute.
    #[inline]
    pub fn quantity(&self, attributes: &[PointAttribute], attribute: usize, point: usize) -> f64 {
        attributes[attribute].quantity(self.columns[3 + attribute][point])
    }
}

/// Statistics of a selection.
#[derive(Clone, Debug, PartialEq)]
pub struct PointStatistics {
    /// Number of points.
    pub points: u64,
    /// Statistics of x, y and z in world coordinates, and of each attribute with scale and offset;
    /// `None` for a column without numbers.
    pub columns: Vec<Option<ColumnSummary>>,
}

/// Statistics of a column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColumnSummary {
    /// Number of values that are numbers.
    pub count: u64,
    /// Minimum.
    pub min: f64,
    /// Maximum.
    pub max: f64,
    /// Mean.
    pub mean: f64,
}

impl PointStatistics {
    fn of(statistics: &Statistics, grid: &PointGrid, attributes: &[PointAttribute]) -> PointStatistics {
        let summary = |(column, found): (usize, &crate::statistics::ColumnStatistics)| {
            if found.count == 0 {
                return None;
            }
            let (sample, scale, offset) = match column.checked_sub(3) {
                None => (SampleType::I32, grid.scale[column], grid.offset[column]),
                Some(attribute) => {
                    let attribute = &attributes[attribute];
                    let (scale, offset) = attribute.scale_offset.unwrap_or((1.0, 0.0));
                    (attribute.sample, scale, offset)
                }
            };
            let ends = [found.least, found.most].map(|number| to_f64(sample, number) * scale + offset);
            let mean = found.sum / found.count as f64 * scale + offset;
            Some(ColumnSummary {
                count: found.count,
                min: ends[0].min(ends[1]),
                max: ends[0].max(ends[1]),
                mean,
            })
        };
        PointStatistics {
            points: statistics.points,
            columns: statistics.columns.iter().enumerate().map(summary).collect(),
        }
    }
}

/// A block to read, and whether it lies entirely in the region.
#[derive(Clone, Copy)]
struct SelectedBlock {
    block: usize,
    is_whole: bool,
}

impl PointTree {
    /// Yields the points of a selection, block by block, in node order, so that a coarse level
    /// comes before the levels below it. `attributes` are the indices to read; `None` reads all.
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read, and those of `each`.
    pub fn select(
        &self,
        selection: &Selection,
        attributes: Option<&[usize]>,
        progress: &dyn Progress,
        each: &mut dyn FnMut(&PointColumns) -> Result<()>,
    ) -> Result<()> {
        let region = selection.region.on(self.grid())?;
        let chosen = self.chosen(&region, selection)?;
        let mut wanted = vec![attributes.is_none(); self.columns()];
        wanted[..3].fill(true);
        attributes.unwrap_or_default().iter().for_each(|attribute| wanted[3 + attribute] = true);
        // The batch size keeps all threads busy. A block has at most 2^20 points, usually far
        // fewer.
        for batch in chosen.chunks(4 * parallel::threads()) {
            progress.check()?;
            for points in parallel::map(batch, |chosen| self.points_of(*chosen, &region, selection, &wanted))
            {
                let points = points?;
                if !points.is_empty() {
                    each(&points)?;
                }
            }
            progress.advance(batch.len() as u64, chosen.len() as u64);
        }
        Ok(())
    }

    /// Counts the points of a selection. Without conditions and level, nodes inside the region are
    /// not read.
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn count(&self, selection: &Selection, progress: &dyn Progress) -> Result<u64> {
        let wanted = [true; 3].into_iter().chain(std::iter::repeat_n(false, self.columns() - 3)).collect();
        Ok(self.sum(selection, wanted, progress)?.points)
    }

    /// Returns counts, extremes and means of the points of a selection.
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn statistics(&self, selection: &Selection, progress: &dyn Progress) -> Result<PointStatistics> {
        let sum = self.sum(selection, vec![true; self.columns()], progress)?;
        Ok(PointStatistics::of(&sum, self.grid(), self.attributes()))
    }

    fn sum(&self, selection: &Selection, wanted: Vec<bool>, progress: &dyn Progress) -> Result<Statistics> {
        let region = selection.region.on(self.grid())?;
        let mut sum = Statistics::none(self.columns());
        let mut cut = Vec::new();
        let reads_all = selection.level.is_some() || !selection.conditions.is_empty();
        self.walk(&region, selection, &mut |node, cover| {
            if cover == Cover::Whole && !reads_all {
                sum.add(&node.statistics);
                return false;
            }
            self.add_blocks(node, cover, &region, &mut cut);
            true
        })?;
        for batch in cut.chunks(4 * parallel::threads()) {
            progress.check()?;
            let found = parallel::map(batch, |chosen| self.points_of(*chosen, &region, selection, &wanted));
            for points in found {
                let mut columns = points?.columns;
                let points = columns[0].len();
                columns.iter_mut().for_each(|column| column.resize(points, 0));
                sum.add(&Statistics::of(&columns, self.attributes()));
            }
            progress.advance(batch.len() as u64, cut.len() as u64);
        }
        Ok(sum)
    }

    /// Traverses the nodes that may have selected points, from the root down. `visit` returns
    /// whether to descend.
    fn walk(
        &self,
        region: &GridRegion,
        selection: &Selection,
        visit: &mut dyn FnMut(&PointNode, Cover) -> bool,
    ) -> Result<()> {
        let mut open: Vec<PointNode> = self.root()?.into_iter().collect();
        while let Some(node) = open.pop() {
            if selection.level.is_some_and(|level| node.code.level() > level) {
                continue;
            }
            let may_hold = |condition: &PointCondition| {
                let column = &node.statistics.columns[3 + condition.attribute];
                condition.may_hold(&self.attributes()[condition.attribute], column, node.statistics.points)
            };
            if !selection.conditions.iter().all(may_hold) {
                continue;
            }
            let cover = region.cover(self.grid(), node.statistics.bounds());
            if cover != Cover::Nothing && visit(&node, cover) {
                open.extend(self.children(&node)?.into_iter().rev());
            }
        }
        Ok(())
    }

    fn add_blocks(
        &self,
        node: &PointNode,
        cover: Cover,
        region: &GridRegion,
        chosen: &mut Vec<SelectedBlock>,
    ) {
        for block in self.blocks_of(node.code) {
            let cover = match cover {
                Cover::Partial => region.cover(self.grid(), self.entry(block).bounds),
                other => other,
            };
            if cover != Cover::Nothing {
                chosen.push(SelectedBlock { block, is_whole: cover == Cover::Whole });
            }
        }
    }

    /// Returns the blocks that may have selected points.
    fn chosen(&self, region: &GridRegion, selection: &Selection) -> Result<Vec<SelectedBlock>> {
        let mut chosen = Vec::new();
        self.walk(region, selection, &mut |node, cover| {
            self.add_blocks(node, cover, region, &mut chosen);
            true
        })?;
        Ok(chosen)
    }

    /// Returns the selected points of a block.
    fn points_of(
        &self,
        chosen: SelectedBlock,
        region: &GridRegion,
        selection: &Selection,
        wanted: &[bool],
    ) -> Result<PointColumns> {
        let mut needed = wanted.to_vec();
        selection.conditions.iter().for_each(|condition| needed[3 + condition.attribute] = true);
        let mut columns = self.block(chosen.block, &needed)?;
        let attributes = self.attributes();
        let mut keep: Vec<bool> = match chosen.is_whole {
            true => vec![true; columns[0].len()],
            false => (0..columns[0].len())
                .map(|point| region.has(self.grid(), std::array::from_fn(|axis| columns[axis][point] as i32)))
                .collect(),
        };
        for condition in &selection.conditions {
            let attribute = &attributes[condition.attribute];
            let numbers = &columns[3 + condition.attribute];
            keep.iter_mut()
                .zip(numbers)
                .for_each(|(keep, number)| *keep &= condition.holds_for(attribute, *number));
        }
        for (column, wanted) in columns.iter_mut().zip(wanted) {
            if !wanted {
                *column = Vec::new();
            } else if keep.contains(&false) {
                let mut kept = keep.iter();
                column.retain(|_| *kept.next().unwrap_or(&false));
            }
        }
        Ok(PointColumns { columns })
    }
}
