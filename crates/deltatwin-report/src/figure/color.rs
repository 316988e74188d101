//! Palette for colour-blind readers.

/// An sRGB colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Color(
    /// Red.
    pub u8,
    /// Green.
    pub u8,
    /// Blue.
    pub u8,
);

impl Color {
    /// Near-black, for measurements.
    pub const MEASURED: Color = Color(0x3b, 0x3b, 0x3b);
    /// Blue, for the model.
    pub const MODEL: Color = Color(0x00, 0x72, 0xb2);
    /// Vermilion, for the residual.
    pub const RESIDUAL: Color = Color(0xd5, 0x5e, 0x00);
    /// Green, for the improved state.
    pub const IMPROVED: Color = Color(0x00, 0x9e, 0x73);
    /// Grey, for background elements.
    pub const MUTED: Color = Color(0x9a, 0xa3, 0xad);

    /// Relative luminance after WCAG 2.2.
    fn luminance(self) -> f64 {
        let part = |v: u8| {
            let v = f64::from(v) / 255.0;
            if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
        };
        0.2126 * part(self.0) + 0.7152 * part(self.1) + 0.0722 * part(self.2)
    }

    /// Black or white, whichever is read better on this colour.
    pub(super) fn ink(self) -> Self {
        // The contrasts (1 + 0.05)/(L + 0.05) of white and (L + 0.05)/0.05 of black are equal at L = 0.179.
        if self.luminance() > 0.179 { BLACK } else { WHITE }
    }

    /// The colour with the share `1 − strength` of white.
    pub(super) fn pale(self, strength: f64) -> Self {
        let mix = |v: u8| (255.0 - strength * (255.0 - f64::from(v))).round() as u8;
        Self(mix(self.0), mix(self.1), mix(self.2))
    }

    /// The colour as `#0072b2`.
    pub(super) fn hex(self) -> String {
        format!("#{:02x}{:02x}{:02x}", self.0, self.1, self.2)
    }

    /// Colours assigned in turn to curves without one, distinguishable for colour-blind readers.
    pub const CYCLE: [Color; 7] = [
        Color(0x00, 0x72, 0xb2),
        Color(0xd5, 0x5e, 0x00),
        Color(0x00, 0x9e, 0x73),
        Color(0xcc, 0x79, 0xa7),
        Color(0xe6, 0x9f, 0x00),
        Color(0x56, 0xb4, 0xe9),
        Color(0x3b, 0x3b, 0x3b),
    ];
}
/// Ink on a colour, which a dark page leaves as it is, unlike [`TEXT`].
pub(super) const BLACK: Color = Color(0x0d, 0x0d, 0x0d);
pub(super) const TEXT: Color = Color(0x22, 0x26, 0x2b);
pub(super) const QUIET: Color = Color(0x5a, 0x62, 0x6b);
pub(super) const GRID: Color = Color(0xe3, 0xe6, 0xea);
pub(super) const MINOR: Color = Color(0xf0, 0xf2, 0xf4);
pub(super) const FRAME: Color = Color(0xb4, 0xba, 0xc1);
pub(super) const WHITE: Color = Color(0xff, 0xff, 0xff);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ink_on_every_colour_has_the_contrast_for_small_text() {
        let contrast = |a: Color, b: Color| {
            let (a, b) = (a.luminance() + 0.05, b.luminance() + 0.05);
            a.max(b) / a.min(b)
        };
        // The examples of WCAG: black on white 21, #777 on white 4.48.
        assert!((contrast(Color(0, 0, 0), WHITE) - 21.0).abs() < 1e-9);
        assert!((contrast(Color(0x77, 0x77, 0x77), WHITE) - 4.48).abs() < 0.005);
        for color in Color::CYCLE.into_iter().chain([Color::MUTED, Color::MODEL, Color::IMPROVED, Color::RESIDUAL]) {
            for strength in [0.15, 0.5, 0.8, 1.0] {
                let pale = color.pale(strength);
                assert!(contrast(pale, pale.ink()) > 4.5, "{pale:?}");
            }
        }
    }
}
