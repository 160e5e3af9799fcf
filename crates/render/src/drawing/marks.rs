//! Polygons and lines of a drawing, from back to front.

/// How a mark is painted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ink {
    /// Interior of a convex polygon.
    Fill([u8; 3]),
    /// Line segments, two points each.
    Lines,
}

/// Marks of a drawing, each painted over those before it. Points are in pixels from the upper left
/// corner.
pub(super) struct Marks {
    /// Background colour; `None` is transparent.
    pub(super) background: Option<[u8; 3]>,
    points: Vec<[f64; 2]>,
    /// Each mark with the end index of its points.
    marks: Vec<(Ink, usize)>,
}

/// Mean intensity of a background below which lines are white.
const DARK: u32 = 96;

impl Marks {
    pub(super) fn new(background: Option<[u8; 3]>) -> Marks {
        Marks { background, points: Vec::new(), marks: Vec::new() }
    }

    /// Colour of faces that hide others and have no colour of their own.
    pub(super) fn paper(&self) -> [u8; 3] {
        self.background.unwrap_or([255; 3])
    }

    /// Colour of lines.
    pub(super) fn line_colour(&self) -> [u8; 3] {
        let sum: u32 = self.paper().into_iter().map(u32::from).sum();
        if sum < 3 * DARK { [255; 3] } else { [0; 3] }
    }

    pub(super) fn fill(&mut self, colour: [u8; 3], corners: impl IntoIterator<Item = [f64; 2]>) {
        self.points.extend(corners);
        self.marks.push((Ink::Fill(colour), self.points.len()));
    }

    /// Adds line segments. Consecutive calls extend the same mark.
    pub(super) fn lines(&mut self, segments: impl IntoIterator<Item = [[f64; 2]; 2]>) {
        let known = self.points.len();
        self.points.extend(segments.into_iter().flatten());
        match self.marks.last_mut() {
            _ if self.points.len() == known => {}
            Some((Ink::Lines, end)) => *end = self.points.len(),
            _ => self.marks.push((Ink::Lines, self.points.len())),
        }
    }

    /// Iterates over all marks with their points.
    pub(super) fn each(&self) -> impl Iterator<Item = (Ink, &[[f64; 2]])> {
        let starts = std::iter::once(0).chain(self.marks.iter().map(|(_, end)| *end));
        starts.zip(&self.marks).map(|(start, (ink, end))| (*ink, &self.points[start..*end]))
    }
}

/// Width of lines, in pixels.
pub(super) const LINE_WIDTH: f64 = 1.5;
