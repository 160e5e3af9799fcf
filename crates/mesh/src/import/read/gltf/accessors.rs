//! Accessors: typed views of bytes, with sparse changes.

use std::collections::BTreeSet;

use super::super::model_file::ModelFile;
use super::buffers::Buffers;
use super::document::{Accessor, Document, Shape, item};
use spinney_base::Result;

/// Scalar type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Scalar {
    fn of(number: u32) -> Option<Scalar> {
        Some(match number {
            5120 => Scalar::I8,
            5121 => Scalar::U8,
            5122 => Scalar::I16,
            5123 => Scalar::U16,
            5125 => Scalar::U32,
            5126 => Scalar::F32,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::U32 | Scalar::F32 => 4,
        }
    }

    fn is_index(self) -> bool {
        matches!(self, Scalar::U8 | Scalar::U16 | Scalar::U32)
    }

    /// Number at the start of `bytes`, of which there must be enough.
    #[inline]
    fn read(self, bytes: &[u8]) -> f64 {
        match self {
            Scalar::I8 => i8::from_le_bytes([bytes[0]]).into(),
            Scalar::U8 => bytes[0].into(),
            Scalar::I16 => i16::from_le_bytes([bytes[0], bytes[1]]).into(),
            Scalar::U16 => u16::from_le_bytes([bytes[0], bytes[1]]).into(),
            Scalar::U32 => u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]).into(),
            Scalar::F32 => f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]).into(),
        }
    }

    /// Normalized number: integers are fractions of their maximum.
    #[inline]
    fn normalize(self, number: f64) -> f64 {
        match self {
            Scalar::I8 => (number / 127.0).max(-1.0),
            Scalar::U8 => number / 255.0,
            Scalar::I16 => (number / 32767.0).max(-1.0),
            Scalar::U16 => number / 65535.0,
            Scalar::U32 | Scalar::F32 => number,
        }
    }
}

/// Use of an accessor, which decides about its types.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    Positions,
    Colours,
    Indices,
    /// Translations or scales of instances.
    Vectors,
    /// Rotations of instances.
    Rotations,
    /// Identifiers of features.
    Features,
}

impl Purpose {
    fn allows(self, shape: Shape, scalar: Scalar, normalized: bool) -> bool {
        match self {
            Purpose::Positions => shape == Shape::Vec3 && scalar != Scalar::U32,
            Purpose::Colours => {
                let is_number =
                    scalar == Scalar::F32 || normalized && matches!(scalar, Scalar::U8 | Scalar::U16);
                matches!(shape, Shape::Vec3 | Shape::Vec4) && is_number
            }
            Purpose::Indices => shape == Shape::Scalar && scalar.is_index() && !normalized,
            Purpose::Vectors => shape == Shape::Vec3 && scalar == Scalar::F32,
            Purpose::Rotations => {
                let is_number =
                    scalar == Scalar::F32 || normalized && matches!(scalar, Scalar::I8 | Scalar::I16);
                shape == Shape::Vec4 && is_number
            }
            Purpose::Features => {
                shape == Shape::Scalar && (scalar.is_index() || scalar == Scalar::F32) && !normalized
            }
        }
    }

    fn expected(self) -> &'static str {
        match self {
            Purpose::Positions => "VEC3 of floats or quantized integers",
            Purpose::Colours => "VEC3 or VEC4 of floats or normalized unsigned integers",
            Purpose::Indices => "SCALAR of unsigned integers",
            Purpose::Vectors => "VEC3 of floats",
            Purpose::Rotations => "VEC4 of floats or normalized integers",
            Purpose::Features => "SCALAR of unsigned integers or floats",
        }
    }
}

/// Elements of an accessor that has been checked: all are within their views.
#[derive(Clone, Debug)]
pub(super) struct Elements {
    pub(super) count: u64,
    scalar: Scalar,
    /// Numbers of an element.
    width: usize,
    normalized: bool,
    /// View and offset of the first element; `None` if all numbers are zero.
    view: Option<(u32, usize)>,
    /// Bytes from one element to the next.
    stride: usize,
    sparse: Option<Changes>,
}

/// Elements that replace others.
#[derive(Clone, Debug)]
struct Changes {
    count: usize,
    /// Their indices, which increase: view, offset and scalar type.
    indices: (u32, usize, Scalar),
    /// View and offset of the first one.
    values: (u32, usize),
}

/// Adds the views that an accessor uses.
pub(super) fn add_views(
    source: &ModelFile,
    document: &Document<'_>,
    index: u32,
    views: &mut BTreeSet<u32>,
) -> Result<()> {
    let Accessor { buffer_view, sparse, .. } =
        item(source, &document.accessors, ("accessor", index), &"meshes and nodes")?;
    views.extend(*buffer_view);
    let sparse = sparse.as_ref();
    views.extend(sparse.into_iter().flat_map(|it| [it.indices.buffer_view, it.values.buffer_view]));
    Ok(())
}

impl Elements {
    pub(super) fn of(
        source: &ModelFile,
        document: &Document<'_>,
        buffers: &Buffers,
        index: u32,
        purpose: Purpose,
    ) -> Result<Elements> {
        let place = format!("accessor {index}");
        let accessor = item(source, &document.accessors, ("accessor", index), &"meshes and nodes")?;
        let Accessor { shape, count, normalized, .. } = *accessor;
        let scalar = Scalar::of(accessor.component_type);
        let Some(scalar) = scalar.filter(|scalar| purpose.allows(shape, *scalar, normalized)) else {
            let normalized = if normalized { ", normalized" } else { "" };
            let found = format!("{shape:?} of component type {}{normalized}", accessor.component_type);
            return Err(source.corrupt(place, found, purpose.expected()));
        };
        let width = match shape {
            Shape::Scalar | Shape::Other => 1,
            Shape::Vec2 => 2,
            Shape::Vec3 => 3,
            Shape::Vec4 => 4,
        };
        let size = width * scalar.size();
        let check = |view: u32, offset: u64, stride: usize, size: usize, count: u64| {
            let length = buffers.view(source, view).len() as u64;
            let needed = match count {
                0 => Some(0),
                _ => (count - 1).checked_mul(stride as u64).and_then(|all| all.checked_add(size as u64)),
            };
            match needed.and_then(|needed| needed.checked_add(offset)) {
                Some(end) if end <= length => Ok(offset as usize),
                _ => {
                    let found = format!("{count} elements of {size} bytes from byte {offset}");
                    let expected = format!("elements within buffer view {view}, which has {length} bytes");
                    Err(source.corrupt(&place, found, expected))
                }
            }
        };
        let mut stride = size;
        let view = match accessor.buffer_view {
            None => {
                // Elements without bytes are all zero: their number must have another limit.
                let limit = (source.bytes().len() as u64).max(1 << 12);
                if count > limit {
                    let found = format!("{count} elements without a buffer view");
                    return Err(source.corrupt(place, found, format!("at most {limit}")));
                }
                None
            }
            Some(view) => {
                let declared = document.buffer_views.get(view as usize).and_then(|view| view.byte_stride);
                if let Some(declared) = declared {
                    stride = usize::try_from(declared).unwrap_or(usize::MAX);
                    if stride < size {
                        let found = format!("{size} bytes per element at a stride of {stride}");
                        return Err(source.corrupt(place, found, "a stride of at least an element"));
                    }
                }
                Some((view, check(view, accessor.byte_offset, stride, size, count)?))
            }
        };
        let mut elements = Elements { count, scalar, width, normalized, view, stride, sparse: None };
        if let Some(sparse) = &accessor.sparse {
            let kind = Scalar::of(sparse.indices.component_type).filter(|scalar| scalar.is_index());
            let Some(kind) = kind else {
                let found = format!("sparse indices of component type {}", sparse.indices.component_type);
                return Err(source.corrupt(place, found, "unsigned integers"));
            };
            let (indices, values) = (&sparse.indices, &sparse.values);
            let first =
                check(indices.buffer_view, indices.byte_offset, kind.size(), kind.size(), sparse.count)?;
            let value = check(values.buffer_view, values.byte_offset, size, size, sparse.count)?;
            let changes = Changes {
                count: sparse.count as usize,
                indices: (indices.buffer_view, first, kind),
                values: (values.buffer_view, value),
            };
            let (mut before, bytes) = (None, buffers.view(source, indices.buffer_view));
            for number in 0..changes.count {
                let index = changes.index(bytes, number);
                if index >= count || before.is_some_and(|before| before >= index) {
                    let found = format!("sparse index {index} after {}", before.unwrap_or_default());
                    return Err(source.corrupt(place, found, format!("increasing indices below {count}")));
                }
                before = Some(index);
            }
            elements.sparse = Some(changes).filter(|changes| changes.count > 0);
        }
        Ok(elements)
    }

    pub(super) fn reader<'a>(&'a self, source: &'a ModelFile, buffers: &'a Buffers) -> Reader<'a> {
        let from = |(view, offset): (u32, usize)| &buffers.view(source, view)[offset..];
        let bytes = self.view.map(from);
        let changes = self
            .sparse
            .as_ref()
            .map(|changes| (changes, buffers.view(source, changes.indices.0), from(changes.values)));
        Reader { elements: self, bytes, changes }
    }
}

impl Changes {
    /// Index of an element. `bytes` are those of the view of indices.
    fn index(&self, bytes: &[u8], number: usize) -> u64 {
        let (_, first, scalar) = self.indices;
        scalar.read(&bytes[first + number * scalar.size()..]) as u64
    }
}

/// Random access to elements.
#[derive(Clone, Copy)]
pub(super) struct Reader<'a> {
    elements: &'a Elements,
    bytes: Option<&'a [u8]>,
    /// Changes, bytes of their indices and of their values.
    changes: Option<(&'a Changes, &'a [u8], &'a [u8])>,
}

impl Reader<'_> {
    pub(super) fn len(&self) -> u64 {
        self.elements.count
    }

    /// Numbers of an element. `N` must be at most the width of elements, and `number` less than
    /// their count.
    #[inline]
    pub(super) fn get<const N: usize>(&self, number: u64) -> [f64; N] {
        let Elements { scalar, stride, normalized, width, .. } = *self.elements;
        debug_assert!(N <= width && number < self.elements.count);
        let mut bytes = self.bytes.map(|bytes| &bytes[number as usize * stride..]);
        if let Some((changes, indices, values)) = self.changes {
            let (mut low, mut high) = (0, changes.count);
            while low < high {
                let middle = usize::midpoint(low, high);
                if changes.index(indices, middle) < number { low = middle + 1 } else { high = middle }
            }
            if low < changes.count && changes.index(indices, low) == number {
                bytes = Some(&values[low * width * scalar.size()..]);
            }
        }
        let Some(bytes) = bytes else { return [0.0; N] };
        std::array::from_fn(|component| {
            let number = scalar.read(&bytes[component * scalar.size()..]);
            if normalized { scalar.normalize(number) } else { number }
        })
    }

    /// Integer, for indices.
    #[inline]
    pub(super) fn integer(&self, number: u64) -> u64 {
        self.get::<1>(number)[0] as u64
    }
}
