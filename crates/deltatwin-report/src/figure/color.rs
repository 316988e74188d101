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
pub(super) const TEXT: Color = Color(0x22, 0x26, 0x2b);
pub(super) const QUIET: Color = Color(0x5a, 0x62, 0x6b);
pub(super) const GRID: Color = Color(0xe3, 0xe6, 0xea);
pub(super) const MINOR: Color = Color(0xf0, 0xf2, 0xf4);
pub(super) const FRAME: Color = Color(0xb4, 0xba, 0xc1);
pub(super) const WHITE: Color = Color(0xff, 0xff, 0xff);
