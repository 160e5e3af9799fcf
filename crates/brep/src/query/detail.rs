//! Surfaces at a level of detail, or for an error: sets of clusters.

use std::ops::Range;

use crate::store::levels::{Cluster, NO_BLOCK};
use crate::{ExactModel, Face, FaceBuffer, Faces, Grid, ModelNode, ModelNodeState, curve};
use spinney_base::{Error, Result, sort};

/// Number of blocks of coarse faces that are fetched at once from a remote file.
const FETCHED_BLOCKS: usize = 64;

/// How much detail a surface has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Detail {
    /// As few faces as possible, whose distance from the exact surface is at most this, in units of
    /// the world. Bodies whose diameter is at most this may be missing.
    Error(f64),
    /// The smallest error for which there are at most this many faces.
    Faces(u64),
    /// A level, from 0, the coarsest.
    Level(u8),
}

/// A surface of a model with levels of detail: closed, and near the exact surface. Coarse surfaces
/// may intersect themselves, within their error; they are for display.
///
/// Faces of coarse clusters are triangles without values.
pub struct DetailSurface<'a> {
    model: &'a ExactModel,
    clusters: Vec<Cluster>,
    len: u64,
    error: f64,
}

impl ExactModel {
    /// Chooses a surface by its detail. In a box of the world, if there is one, it consists of all
    /// clusters that touch the box, and is not closed outside of it. Reads the tables of clusters,
    /// 64 bytes per 500 faces.
    ///
    /// # Errors
    /// If the file has no levels or not this one, if it is corrupt, or if it cannot be read.
    pub fn at_detail(&self, detail: Detail, within: Option<[[f64; 3]; 2]>) -> Result<DetailSurface<'_>> {
        let levels = self.levels().len();
        if levels == 0 {
            let advice = "add levels with `spinney transform FILE levels -o OUTPUT`";
            return Err(Error::unsupported(self.path(), "an exact model without levels of detail", advice));
        }
        let width = self.grid().width();
        let error = match detail {
            Detail::Level(level) if usize::from(level) >= levels => {
                let expected = format!("at most {}, the level of the exact surface", levels - 1);
                return Err(Error::invalid("level", level.to_string(), expected));
            }
            Detail::Level(_) => 0.0,
            // (The coarsest clusters are replaced at infinity.)
            Detail::Error(error) if error >= 0.0 => (error / width).min(f64::from(f32::MAX)),
            Detail::Error(error) => return Err(Error::invalid("error", error.to_string(), "0 or more")),
            Detail::Faces(most) => self.error_for(most)?,
        };
        let within = within.map(|corners| corners.map(|corner| self.grid().to_grid(corner)));
        let touches = |[low, high]: &[[i32; 3]; 2]| {
            within.is_none_or(|[min, max]| {
                (0..3).all(|axis| f64::from(low[axis]) <= max[axis] && f64::from(high[axis]) >= min[axis])
            })
        };
        let mut surface = DetailSurface { model: self, clusters: Vec::new(), len: 0, error: 0.0 };
        let (mut last_key, mut last_face) = (0, (0, 0));
        // The surface for an error is nowhere finer than a level whose error is not larger.
        let finest = match detail {
            Detail::Level(level) => level.into(),
            _ => self.levels().iter().position(|level| level.error <= error).unwrap_or(levels - 1),
        };
        self.each_cluster(finest, &mut |cluster| {
            let is_in = match detail {
                Detail::Level(level) => cluster.is_in_level(level),
                _ => cluster.is_in_cut(error),
            };
            // Invariant: no face is in two clusters, which bounds the faces of a surface by those
            // of the file: positions on the curve ascend, and so do faces of blocks.
            let face = (cluster.block, cluster.first);
            let is_next = match self.is_exact(cluster) {
                true => cluster.keys.start >= last_key && cluster.keys.end >= cluster.keys.start,
                false => face >= last_face,
            };
            if !is_next {
                return Err(self.wrong_cluster(cluster, "clusters that do not overlap"));
            }
            match self.is_exact(cluster) {
                true => last_key = cluster.keys.end,
                false => last_face = (face.0, face.1.saturating_add(cluster.faces)),
            }
            if is_in && touches(&cluster.bounds) {
                surface.len += self.faces_of(cluster);
                surface.error = surface.error.max(cluster.error.into());
                surface.clusters.push(cluster.clone());
            }
            Ok(())
        })?;
        Ok(surface)
    }

    /// Returns the smallest error for which the surface has at most `most` faces.
    fn error_for(&self, most: u64) -> Result<f64> {
        // Errors at which faces are added and removed, as sortable numbers: they are not negative.
        let mut changes: Vec<(u32, i64)> = Vec::new();
        self.each_cluster(self.levels().len() - 1, &mut |cluster| {
            let faces = self.faces_of(cluster) as i64;
            changes.extend([(cluster.error.to_bits(), faces), (cluster.limit.to_bits(), -faces)]);
            Ok(())
        })?;
        if changes.is_empty() {
            // A model without faces.
            return Ok(0.0);
        }
        sort::by_key(&mut changes, |change| change.0.into());
        let (mut faces, mut fewest) = (0, i64::MAX);
        for same in changes.chunk_by(|a, b| a.0 == b.0) {
            faces += same.iter().map(|change| change.1).sum::<i64>();
            let is_enough = u64::try_from(faces).is_ok_and(|faces| faces <= most);
            if is_enough && f32::from_bits(same[0].0).is_finite() {
                return Ok(f32::from_bits(same[0].0).into());
            }
            fewest = if f32::from_bits(same[0].0).is_finite() { fewest.min(faces) } else { fewest };
        }
        Err(Error::invalid(
            "faces",
            most.to_string(),
            format!("at least {fewest}, those of the coarsest level"),
        ))
    }

    fn is_exact(&self, cluster: &Cluster) -> bool {
        usize::from(cluster.level) + 1 == self.levels().len()
    }

    fn faces_of(&self, cluster: &Cluster) -> u64 {
        let slivers = if self.is_exact(cluster) { cluster.first } else { 0 };
        u64::from(cluster.faces) + u64::from(slivers)
    }

    /// Visits the faces with an area whose positions on the curve are in a range.
    fn each_on_curve(
        &self,
        keys: &Range<u64>,
        node: &ModelNode<'_>,
        buffer: &mut FaceBuffer,
        each: &mut dyn FnMut(&Face<'_>) -> Result<()>,
    ) -> Result<()> {
        let own = curve::positions_in(node.level(), node.position(), self.grid().bits);
        if own.start >= keys.end || own.end <= keys.start {
            return Ok(());
        }
        if node.state() == ModelNodeState::Inner {
            return (0..8)
                .try_for_each(|child| self.each_on_curve(keys, &self.child(node, child)?, buffer, each));
        }
        // Invariant: each face is visited once. The vertex that decides its position is inside of
        // one leaf's cell, which lists the face.
        for number in node.faces() {
            self.face(number, buffer)?;
            let face = buffer.face();
            let key = curve::position(&face, self.grid().bits);
            if keys.contains(&key) && own.contains(&key) {
                each(&face)?;
            }
        }
        Ok(())
    }
}

impl DetailSurface<'_> {
    /// Returns a bound of the distance between this surface and the exact one in units of the
    /// world, both ways, except for bodies that are missing: their diameter is at most this.
    pub fn error(&self) -> f64 {
        self.error * self.model.grid().width()
    }

    /// Returns the bound in grid units.
    pub(crate) fn grid_error(&self) -> f64 {
        self.error
    }

    /// Returns the number of clusters.
    pub(crate) fn clusters(&self) -> usize {
        self.clusters.len()
    }

    /// Returns whether all faces are those of the exact surface.
    pub fn is_exact(&self) -> bool {
        self.clusters.iter().all(|cluster| self.model.is_exact(cluster))
    }
}

impl Faces for DetailSurface<'_> {
    fn grid(&self) -> &Grid {
        self.model.grid()
    }

    fn parts(&self) -> &[String] {
        self.model.parts()
    }

    fn origin(&self) -> Option<&dyn Faces> {
        Some(self.model)
    }

    fn len(&self) -> u64 {
        self.len
    }

    fn each(&self, each: &mut dyn FnMut(&Face<'_>) -> Result<()>) -> Result<()> {
        let model = self.model;
        let mut buffer = FaceBuffer::default();
        let mut number = 0;
        let mut numbered = |face: &Face<'_>| {
            number += 1;
            each(&Face { number: number - 1, ..*face })
        };
        let blocks = self.clusters.chunk_by(|a, b| a.block == b.block);
        let blocks: Vec<&[Cluster]> = blocks.filter(|same| same[0].block != NO_BLOCK).collect();
        for (index, same) in blocks.iter().enumerate() {
            if index % FETCHED_BLOCKS == 0 {
                let next = blocks[index..].iter().take(FETCHED_BLOCKS).map(|same| same[0].block as usize);
                model.fetch(next, &|block| model.level_block(block).map(drop))?;
            }
            let block = model.level_block(same[0].block as usize)?;
            for cluster in *same {
                let faces = match model.is_exact(cluster) {
                    true => 0..cluster.first,
                    false => cluster.first..cluster.first.saturating_add(cluster.faces),
                };
                if faces.end as usize > block.len() {
                    let expected = format!("faces of a block of {}", block.len());
                    return Err(model.wrong_cluster(cluster, &expected));
                }
                for face in faces {
                    block.read(face as usize, &mut buffer);
                    numbered(&buffer.face())?;
                }
            }
        }
        let exact = self.clusters.iter().filter(|cluster| model.is_exact(cluster));
        let mut ranges: Vec<Range<u64>> = Vec::new();
        for Cluster { keys, .. } in exact {
            match ranges.last_mut() {
                Some(last) if last.end == keys.start => last.end = keys.end,
                _ => ranges.push(keys.clone()),
            }
        }
        if ranges.is_empty() {
            return Ok(());
        }
        let root = model.root()?;
        ranges.iter().try_for_each(|keys| model.each_on_curve(keys, &root, &mut buffer, &mut numbered))
    }
}
