//! Indices of colours, for images with a palette.

/// A palette of at most 256 colours, with a hash table from colour to index.
#[derive(Debug)]
pub(super) struct Indices {
    pub(super) colours: Vec<[u8; 4]>,
    /// Hash table with linear probing. (The name is part of the debug text that tile archives store
    /// a hash of, and must not change.)
    places: Vec<Option<([u8; 4], u8)>>,
}

const SLOTS: usize = 1024;

impl Indices {
    /// Indexes colours in order of first occurrence; `None` if there are more than 256.
    pub(super) fn new(colours: impl IntoIterator<Item = [u8; 4]>) -> Option<Indices> {
        let mut indices = Indices { colours: Vec::new(), places: vec![None; SLOTS] };
        for colour in colours {
            let mut slot = slot(colour);
            while indices.places[slot].is_some_and(|(other, _)| other != colour) {
                slot = (slot + 1) % SLOTS;
            }
            if indices.places[slot].is_none() {
                let index = u8::try_from(indices.colours.len()).ok()?;
                indices.places[slot] = Some((colour, index));
                indices.colours.push(colour);
            }
        }
        Some(indices)
    }

    /// The index of a colour; 0 if it is not in the palette.
    #[inline]
    pub(super) fn index(&self, colour: [u8; 4]) -> u8 {
        let mut slot = slot(colour);
        while let Some((other, index)) = self.places[slot] {
            if other == colour {
                return index;
            }
            slot = (slot + 1) % SLOTS;
        }
        0
    }
}

#[inline]
fn slot(colour: [u8; 4]) -> usize {
    (u32::from_le_bytes(colour).wrapping_mul(0x9E37_79B1) >> 22) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_have_palette_indices() {
        let grey = |grey: u16| [grey as u8, grey as u8, (grey >> 4) as u8, 255];
        let indices = Indices::new((0..256).chain(0..256).map(grey)).unwrap();
        assert_eq!(indices.colours.len(), 256);
        assert!((0..256).all(|i| usize::from(indices.index(grey(i))) == usize::from(i)));
        assert_eq!(indices.index([1, 2, 3, 4]), 0);
        assert!(Indices::new((0..256).map(grey).chain([[0; 4]])).is_none());
    }
}
