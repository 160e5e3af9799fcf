//! Filtered points, with a subset of their attributes.

use std::path::Path;

use super::{PointSchema, PointSource, PointSubset};
use crate::attribute::{POSITION_BYTES, RowLayout};
use crate::query::PointCondition;
use spinney_base::Result;

/// Points that satisfy conditions, with the chosen attributes.
pub struct ChosenPoints {
    source: Box<dyn PointSource>,
    conditions: Vec<PointCondition>,
    /// Indices of the attributes to keep; `None` for all.
    kept: Option<Vec<usize>>,
    schema: PointSchema,
    rows: Vec<u8>,
}

impl ChosenPoints {
    /// Filters a source; `kept` are indices of attributes, `None` for all.
    pub fn new(
        source: Box<dyn PointSource>,
        conditions: Vec<PointCondition>,
        kept: Option<Vec<usize>>,
    ) -> ChosenPoints {
        let mut schema = source.schema().clone();
        if let Some(kept) = &kept {
            schema.layout = RowLayout::packed(
                kept.iter().map(|index| schema.layout.attributes[*index].clone()).collect(),
            );
        }
        if !conditions.is_empty() {
            schema.count = None;
        }
        ChosenPoints { source, conditions, kept, schema, rows: Vec::new() }
    }
}

impl PointSource for ChosenPoints {
    fn schema(&self) -> &PointSchema {
        &self.schema
    }

    fn path(&self) -> &Path {
        self.source.path()
    }

    fn read(&mut self, rows: &mut Vec<u8>, most: usize) -> Result<usize> {
        let layout = self.source.schema().layout.clone();
        loop {
            self.rows.clear();
            if self.source.read(&mut self.rows, most)? == 0 {
                return Ok(0);
            }
            let all = || self.rows.chunks_exact(layout.size);
            let mut keep = vec![true; all().len()];
            for condition in &self.conditions {
                let attribute = &layout.attributes[condition.attribute];
                let numbers = layout.numbers(condition.attribute, all());
                keep.iter_mut()
                    .zip(numbers)
                    .for_each(|(keep, number)| *keep &= condition.holds_for(attribute, number));
            }
            let chosen = || all().zip(&keep).filter(|(_, keep)| **keep).map(|(row, _)| row);
            let before = rows.len();
            match &self.kept {
                None => chosen().for_each(|row| rows.extend_from_slice(row)),
                Some(kept) => {
                    let size = self.schema.layout.size;
                    rows.resize(before + keep.iter().filter(|keep| **keep).count() * size, 0);
                    let mut made: Vec<&mut [u8]> = rows[before..].chunks_exact_mut(size).collect();
                    for (own, row) in made.iter_mut().zip(chosen()) {
                        own[..POSITION_BYTES].copy_from_slice(&row[..POSITION_BYTES]);
                    }
                    for (attribute, from) in kept.iter().enumerate() {
                        let numbers = layout.numbers(*from, chosen());
                        for (own, number) in made.iter_mut().zip(numbers) {
                            self.schema.layout.set_number(attribute, own, number);
                        }
                    }
                }
            }
            let count = (rows.len() - before) / self.schema.layout.size;
            if count > 0 {
                return Ok(count);
            }
        }
    }

    fn subsets(&self) -> &[PointSubset] {
        self.source.subsets()
    }

    fn subset(&self, number: usize) -> Result<Box<dyn PointSource>> {
        let subset = self.source.subset(number)?;
        Ok(Box::new(ChosenPoints::new(subset, self.conditions.clone(), self.kept.clone())))
    }

    fn survey(&mut self) -> Result<bool> {
        let could = self.source.survey()?;
        self.schema.bounds = self.source.schema().bounds;
        Ok(could)
    }
}
