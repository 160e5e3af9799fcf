//! Sizes of images as arguments.

/// Columns and rows of an image, or the longer side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Size {
    Both(u64, u64),
    /// The longer side; the other one keeps the aspect ratio.
    Longer(u64),
}

/// Parses columns and rows of an image, `1024x512`, or the longer side, `1024`.
pub(crate) fn parse_size(text: &str) -> Result<Size, String> {
    let number = |text: &str| text.trim().parse().ok().filter(|number: &u64| *number > 0);
    let size = match text.split_once(['x', 'X', ',']) {
        Some((width, height)) => {
            number(width).zip(number(height)).map(|(width, height)| Size::Both(width, height))
        }
        None => number(text).map(Size::Longer),
    };
    size.ok_or_else(|| "expected WxH, such as 1024x512, or the longer side".into())
}

impl Size {
    /// Returns columns and rows of an image of something `width` wide and `height` high.
    pub(crate) fn of(self, width: u64, height: u64) -> (u64, u64) {
        let longer = match self {
            Size::Both(columns, rows) => return (columns, rows),
            Size::Longer(longer) => longer,
        };
        let shorter =
            (longer as f64 * (width.min(height) as f64 / width.max(height).max(1) as f64)).round() as u64;
        if width >= height { (longer, shorter.max(1)) } else { (shorter.max(1), longer) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_keep_the_aspect() {
        assert_eq!(parse_size("1024x512").map(|size| size.of(3, 3)), Ok((1024, 512)));
        assert_eq!(parse_size("800").map(|size| size.of(1600, 400)), Ok((800, 200)));
        assert_eq!(parse_size("800").map(|size| size.of(1, 1_000_000)), Ok((1, 800)));
        for text in ["", "0", "0x5", "5x", "-1", "a"] {
            assert!(parse_size(text).is_err(), "{text}");
        }
    }
}
