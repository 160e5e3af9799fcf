//! Text in raster legends, in DejaVu Sans, which covers most European languages and some others.

use ab_glyph::{Font, FontRef, OutlinedGlyph, PxScale, ScaleFont, point};

/// Line height in pixels at scale 1, from the highest ascender to the lowest descender.
const HEIGHT: f32 = 11.5;
/// Maximum letters of a line. Longer lines are truncated with an ellipsis.
const MAX_LETTERS: usize = 80;

/// Letters of one size.
pub(super) struct Letters {
    font: FontRef<'static>,
    scale: PxScale,
}

/// A laid-out line of text.
pub(super) struct Line {
    /// Advance width in pixels.
    pub(super) width: usize,
    glyphs: Vec<OutlinedGlyph>,
}

impl Letters {
    /// Loads the font at this scale.
    pub(super) fn new(scale: usize) -> Letters {
        let font = FontRef::try_from_slice(dejavu::sans::regular()).expect("the built-in font is valid");
        Letters { font, scale: PxScale::from(HEIGHT * scale as f32) }
    }

    /// Lays out a line of text.
    pub(super) fn line(&self, text: &str) -> Line {
        let font = self.font.as_scaled(self.scale);
        let is_long = text.chars().nth(MAX_LETTERS).is_some();
        let letters = text.chars().take(if is_long { MAX_LETTERS - 1 } else { MAX_LETTERS });
        let (mut at, mut before, mut glyphs) = (0.0, None, Vec::new());
        for letter in letters.chain(is_long.then_some('…')).filter(|letter| !letter.is_control()) {
            let id = font.glyph_id(letter);
            at += before.map_or(0.0, |before| font.kern(before, id));
            let glyph = id.with_scale_and_position(self.scale, point(at, font.ascent()));
            glyphs.extend(font.outline_glyph(glyph));
            at += font.h_advance(id);
            before = Some(id);
        }
        Line { width: at.ceil() as usize, glyphs }
    }
}

impl Line {
    /// Calls `show` for each pixel that letters touch, with its offset from the line's upper left
    /// corner and its coverage from 0 to 1.
    pub(super) fn draw(&self, show: &mut dyn FnMut([i32; 2], f32)) {
        for glyph in &self.glyphs {
            let corner = glyph.px_bounds().min;
            glyph.draw(|x, y, cover| show([corner.x as i32 + x as i32, corner.y as i32 + y as i32], cover));
        }
    }
}
