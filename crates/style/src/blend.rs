//! Blending of colours with straight alpha in 8 bits (W3C, Compositing and Blending Level 1).

/// Blend mode of a layer with the layers below it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Blend {
    Normal,
    Multiply,
    Screen,
    Overlay,
}

impl Blend {
    pub(super) const ALL: [(&'static str, Blend); 4] = [
        ("normal", Blend::Normal),
        ("multiply", Blend::Multiply),
        ("screen", Blend::Screen),
        ("overlay", Blend::Overlay),
    ];

    #[inline]
    fn mix(self, below: u32, above: u32) -> u32 {
        let multiply = |a: u32, b: u32| share(a * b);
        match self {
            Blend::Normal => above,
            Blend::Multiply => multiply(below, above),
            Blend::Screen => below + above - multiply(below, above),
            Blend::Overlay if below < 128 => multiply(2 * below, above),
            Blend::Overlay => {
                let twice = 2 * below - 255;
                twice + above - multiply(twice, above)
            }
        }
    }

    /// Composites `above` over `below`.
    #[inline]
    pub(super) fn over(self, below: [u8; 4], above: [u8; 4]) -> [u8; 4] {
        let (under, cover) = (u32::from(below[3]), u32::from(above[3]));
        if cover == 0 {
            return below;
        }
        if under == 0 {
            return above;
        }
        // 255 * 255 times the union of both opacities.
        let both = cover * 255 + under * (255 - cover);
        let channel = |i: usize| {
            let (below, above) = (u32::from(below[i]), u32::from(above[i]));
            let mixed = self.mix(below, above);
            let sum = above * cover * (255 - under) + below * under * (255 - cover) + mixed * cover * under;
            ((sum + both / 2) / both) as u8
        };
        [channel(0), channel(1), channel(2), share(both) as u8]
    }
}

/// Scales a product of two 8-bit samples back to 8 bits, rounded.
#[inline]
pub(super) fn share(product: u32) -> u32 {
    (product + 127) / 255
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_blended() {
        let (red, green) = ([255, 0, 0, 255], [0, 255, 0, 255]);
        assert_eq!(Blend::Normal.over(red, green), green);
        assert_eq!(Blend::Normal.over(red, [0, 255, 0, 0]), red);
        assert_eq!(Blend::Normal.over([9, 9, 9, 0], green), green);
        assert_eq!(Blend::Normal.over(red, [0, 255, 0, 51]), [204, 51, 0, 255]);
        assert_eq!(Blend::Normal.over([255, 0, 0, 128], [0, 0, 255, 128]), [85, 0, 170, 192]);
        assert_eq!(Blend::Multiply.over([200, 100, 50, 255], [128, 128, 128, 255]), [100, 50, 25, 255]);
        assert_eq!(Blend::Screen.over([200, 100, 50, 255], [0, 255, 128, 255]), [200, 255, 153, 255]);
        assert_eq!(Blend::Overlay.over([0, 255, 64, 255], [128; 4])[..2], [0, 255]);
        for (_, blend) in Blend::ALL {
            for below in 0..=255 {
                for above in (0..=255).step_by(15) {
                    assert!(blend.mix(below, above) <= 255, "{blend:?} {below} {above}");
                }
            }
        }
    }
}
