//! Trees with converted values: to another type, scale or unit, to other class numbers, to VOID, or
//! to a value that only marks presence.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::affine::View;
use super::tree_file::TreeFile;
use super::view_source::{ViewSource, ViewSourceNode};
use crate::tree::{CellBlock, Child, Children, Source};
use spinney_base::space::Bounds;
use spinney_base::value::{Mask, Number, Value, ValueType};
use spinney_base::{Error, Result, TreeType};
use spinney_container::{Header, Metadata};

/// Conversion of a value.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum ValueMap {
    /// Every value becomes this one.
    Presence(Value),
    /// Each sample becomes factor * sample + summand, by channel. A channel that the source does
    /// not have becomes full opacity.
    Linear([(f64, f64); 4]),
    /// Cells with this value become VOID; all others stay.
    Void(Value),
    /// Transparent cells become VOID; all others stay. Levels above the cells are unchanged, since
    /// transparent cells do not count in them.
    Transparent,
    /// Class numbers are mapped to others; classes that are not listed stay.
    Classes(BTreeMap<Number, Number>),
}

/// Source with converted values and the same nodes.
pub struct Converted {
    source: Arc<ViewSource>,
    header: Header,
    metadata: Metadata,
    map: ValueMap,
}

impl Converted {
    /// Source whose values become those of a type; `metadata` are those of the result.
    pub(super) fn new(
        source: Arc<ViewSource>,
        to: ValueType,
        map: ValueMap,
        metadata: Metadata,
    ) -> Converted {
        let header = source.header();
        let header = Header { form: TreeType { value: to, ..header.form }, ..header.clone() };
        Converted { source, header, metadata, map }
    }

    /// Source with unconverted values.
    pub(super) fn source(&self) -> &ViewSource {
        &self.source
    }

    pub(super) fn header(&self) -> &Header {
        &self.header
    }

    pub(super) fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// Whether values above the cells also count cells that have become VOID.
    pub(super) fn leaves_cells_out(&self) -> bool {
        matches!(self.map, ValueMap::Void(_))
    }

    /// Representative of an INNER node, computed if it was left out.
    pub(super) fn representative(&self, node: &ViewSourceNode, given: Value) -> Result<Value> {
        match &*self.source {
            ViewSource::File(TreeFile::Mosaic(_)) | ViewSource::Converted(_) => {
                Ok(self.value(self.source.representative(node, given)?))
            }
            _ => Ok(given),
        }
    }

    /// Whether cells with a value become VOID.
    fn is_dropped(&self, value: Value) -> bool {
        match self.map {
            ValueMap::Void(dropped) => value == dropped,
            ValueMap::Transparent => self.header.form.value.is_transparent(value),
            _ => false,
        }
    }

    /// Converts a value of the source.
    fn value(&self, value: Value) -> Value {
        let (from, to) = (self.source.form().value, self.header.form.value);
        match &self.map {
            ValueMap::Presence(present) => *present,
            ValueMap::Void(_) | ValueMap::Transparent => value,
            ValueMap::Classes(numbers) => {
                let number = from.first_number(value);
                let number = numbers.get(&number).copied().unwrap_or(number);
                to.nearest_numbers(|_| number)
            }
            ValueMap::Linear(maps) => {
                let (numbers, present) = (from.numbers(value), from.present(value));
                let channels = usize::from(from.channels);
                let missing = to.all_missing().filter(|_| matches!(from.mask, Mask::Missing(_)));
                to.nearest_numbers(|channel| {
                    if channel >= channels {
                        return opaque(from);
                    }
                    match (missing, linear(maps[channel], numbers[channel])) {
                        (Some(missing), _) if !present[channel] => to.numbers(missing)[channel],
                        // (Rounded to the nearest integer, half up, as in means.)
                        (_, Number::Float(number)) if !to.sample.is_float() => {
                            Number::Float((number + 0.5).floor())
                        }
                        (_, number) => number,
                    }
                })
            }
        }
    }

    fn node(&self, child: Child<ViewSourceNode>) -> Child<ViewSourceNode> {
        match child {
            Child::Void => Child::Void,
            Child::Leaf(value) if self.is_dropped(value) => Child::Void,
            Child::Leaf(value) => Child::Leaf(self.value(value)),
            Child::Inner { representative, node } => {
                Child::Inner { representative: self.value(representative), node }
            }
        }
    }

    /// Reads a box of cells of a level inside the tree's space, as [`Source::draw`] does.
    ///
    /// # Errors
    /// If the source is corrupt there.
    pub(super) fn draw_at(
        &self,
        level: u8,
        bounds: &Bounds,
        values: &mut [u8],
        valid: &mut [bool],
    ) -> Result<()> {
        let mut read = vec![0; valid.len() * self.source.form().width()];
        self.source.draw_at(level, bounds, &mut read, valid)?;
        self.convert(&read, valid, values);
        Ok(())
    }

    /// Converts cells in rows; VOID cells are left unchanged.
    fn convert(&self, from: &[u8], valid: &mut [bool], to: &mut [u8]) {
        let (width, new_width) = (self.source.form().width(), self.header.form.width());
        // (Neighbours are often equal.)
        let mut last: Option<(Value, [u8; 16])> = None;
        let cells = from.chunks_exact(width).zip(to.chunks_exact_mut(new_width)).zip(valid.iter_mut());
        for ((from, to), valid) in cells.filter(|(_, valid)| **valid) {
            let value = Value::from_bytes(from);
            if self.is_dropped(value) {
                *valid = false;
                continue;
            }
            let bytes = match last {
                Some((before, bytes)) if before == value => bytes,
                _ => self.value(value).to_bytes(),
            };
            last = Some((value, bytes));
            to.copy_from_slice(&bytes[..new_width]);
        }
    }
}

/// Sample of full opacity.
fn opaque(value_type: ValueType) -> Number {
    match value_type.sample.size() {
        _ if value_type.sample.is_float() => 1.into(),
        1 => 255.into(),
        _ => 65535.into(),
    }
}

/// Applies a linear map to a number, exactly if number, factor and summand are integers.
fn linear((factor, summand): (f64, f64), number: Number) -> Number {
    if (factor, summand) == (1.0, 0.0) {
        return number;
    }
    let whole = |number: f64| (number == number.trunc() && number.abs() < 9e15).then_some(number as i128);
    if let (Some(factor), Some(summand), Some(number)) = (whole(factor), whole(summand), number.to_integer())
        && let Some(result) = number.checked_mul(factor).and_then(|product| product.checked_add(summand))
    {
        return match (u64::try_from(result), i64::try_from(result)) {
            (Ok(result), _) => Number::Unsigned(result),
            (_, Ok(result)) => Number::Signed(result),
            _ => Number::Float(result as f64),
        };
    }
    Number::Float(number.to_f64() * factor + summand)
}

impl Source for Converted {
    type Node = ViewSourceNode;

    fn form(&self) -> TreeType {
        self.header.form
    }

    fn depth(&self) -> u8 {
        self.source.depth()
    }

    fn root(&self) -> Result<Child<ViewSourceNode>> {
        Ok(self.node(self.source.root()?))
    }

    fn children(&self, node: &ViewSourceNode, children: &mut Children<ViewSourceNode>) -> Result<()> {
        self.source.children(node, children)?;
        for child in children.iter_mut() {
            *child = self.node(*child);
        }
        Ok(())
    }

    fn draw(&self, bounds: &Bounds, values: &mut [u8], valid: &mut [bool]) -> Result<bool> {
        let mut read = vec![0; valid.len() * self.source.form().width()];
        let is_drawn = self.source.draw(bounds, &mut read, valid)?;
        if is_drawn {
            self.convert(&read, valid, values);
        }
        Ok(is_drawn)
    }

    fn cells(&self, node: &ViewSourceNode, levels: u8) -> Result<Option<CellBlock>> {
        let Some(cells) = self.source.cells(node, levels)? else { return Ok(None) };
        let mut converted = CellBlock::void(cells.present.len(), self.header.form.width());
        converted.present = cells.present;
        self.convert(&cells.values, &mut converted.present, &mut converted.values);
        Ok(Some(converted))
    }

    fn check_unchanged(&self) -> Result<()> {
        self.source.check_unchanged()
    }
}

impl View {
    /// View in which cells become VOID that have a number in all channels. The number is the
    /// result's nodata.
    ///
    /// # Errors
    /// If the type cannot hold the number.
    pub(super) fn without_number(self, number: Number) -> Result<View> {
        let value_type = self.form().value;
        let value = value_type.splat(number).ok_or_else(|| {
            let expected = format!("a number that {value_type} can hold");
            Error::invalid("number of VOID cells", number.to_string(), expected)
        })?;
        let metadata = Metadata { nodata: Some(number), ..self.source().metadata().clone() };
        let source = self.source().clone();
        Ok(self.converted(Converted::new(source, value_type, ValueMap::Void(value), metadata)))
    }

    /// View in which transparent cells become VOID: those with opacity 0, in values with opacity
    /// ([`Mask::Alpha`]).
    ///
    /// # Errors
    /// If the file is corrupt, when checking whether it has any.
    pub fn opaque(self) -> Result<View> {
        let value_type = self.source().header().form.value;
        if value_type.mask != Mask::Alpha {
            return Ok(self);
        }
        // A file without transparent cells is used unchanged, so that its stored subtrees can be
        // reused.
        if let ViewSource::File(_) = &**self.source() {
            let totals = self.source().totals(None)?;
            if totals.channels.iter().all(|channel| channel.cells == totals.cells) {
                return Ok(self);
            }
        }
        let (source, metadata) = (self.source().clone(), self.source().metadata().clone());
        Ok(self.converted(Converted::new(source, value_type, ValueMap::Transparent, metadata)))
    }

    /// View with converted values.
    pub(super) fn converted(self, converted: Converted) -> View {
        self.over(Arc::new(ViewSource::Converted(Box::new(converted))))
    }
}
