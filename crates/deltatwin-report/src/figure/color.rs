//! Palette for colour-blind readers. What is measured, the stages of a model and the noise have the same colours in all
//! pictures and on all pages; page and studio get them as variables of their style.

use std::fmt::Write as _;

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
    /// Blue; of a model the identified one.
    pub const BLUE: Color = Color(0x00, 0x72, 0xb2);
    /// Vermilion; of a model the nominal one.
    pub const VERMILION: Color = Color(0xd5, 0x5e, 0x00);
    /// Green; of a model the one with an effect added.
    pub const GREEN: Color = Color(0x00, 0x9e, 0x73);
    /// Purple; of a model an earlier version.
    pub const PURPLE: Color = Color(0xcc, 0x79, 0xa7);
    /// Ochre, for what is open.
    pub const OCHRE: Color = Color(0xe6, 0x9f, 0x00);
    /// Light blue.
    pub const SKY: Color = Color(0x56, 0xb4, 0xe9);
    /// Grey, for background elements.
    pub const MUTED: Color = Color(0x9a, 0xa3, 0xad);
    /// Dark grey, for the noise.
    pub const NOISE: Color = QUIET;
    /// Dark green, for what is right or safe; unlike [`Color::GREEN`] not of a model.
    pub const GOOD: Color = Color(0x3d, 0x7a, 0x1f);
    /// Brown, for what is doubtful.
    pub const DOUBTFUL: Color = Color(0x8a, 0x5d, 0x00);
    /// Dark red, for what is wrong or breaks; unlike [`Color::VERMILION`] not of a model.
    pub const BAD: Color = Color(0xb8, 0x32, 0x27);
    /// The axes of a machine in order; a fifth has the first again.
    pub const OF_AXIS: [Color; 4] =
        [Color(0x7a, 0x5c, 0xc4), Color(0x94, 0x62, 0x00), Color(0x3f, 0x7f, 0x88), Color(0xb0, 0x57, 0x8a)];

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
    pub const CYCLE: [Color; 7] =
        [Self::BLUE, Self::VERMILION, Self::GREEN, Self::PURPLE, Self::OCHRE, Self::SKY, Self::MEASURED];

    /// Variable of a page's style with this colour; `None` if it has none.
    pub(super) fn variable(self) -> Option<&'static str> {
        SHADES.iter().find(|s| s.paper == self).map(|s| s.name)
    }
}

/// Stage of a model, which has the same colour in all pictures and on all pages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// As delivered, before anything was fitted.
    Nominal,
    /// With identified parameters.
    Identified,
    /// An earlier version, next to one of the same kind.
    Earlier,
    /// With an effect added.
    Added,
}

impl Role {
    /// Its colour on paper.
    pub fn color(self) -> Color {
        match self {
            Self::Nominal => Color::VERMILION,
            Self::Identified => Color::BLUE,
            Self::Earlier => Color::PURPLE,
            Self::Added => Color::GREEN,
        }
    }

    /// Class and variable of the style with its colour.
    pub fn class(self) -> &'static str {
        self.color().variable().unwrap_or_default()
    }
}

/// A colour of a page: on paper, and on a light and a dark screen, where it has a contrast of 3 with the ground.
struct Shade {
    name: &'static str,
    paper: Color,
    light: Color,
    dark: Color,
}

const fn shade(name: &'static str, paper: Color, light: u32, dark: u32) -> Shade {
    const fn rgb(x: u32) -> Color {
        Color((x >> 16) as u8, (x >> 8) as u8, x as u8)
    }
    Shade { name, paper, light: rgb(light), dark: rgb(dark) }
}

const SHADES: [Shade; 16] = [
    shade("measured", Color::MEASURED, 0x3b_3b3b, 0xaa_b2ba),
    shade("nominal", Color::VERMILION, 0xc6_5500, 0xf2_8a3c),
    shade("identified", Color::BLUE, 0x00_72b2, 0x57_b0ea),
    shade("earlier", Color::PURPLE, 0xb0_578a, 0xe0_9cc3),
    shade("added", Color::GREEN, 0x00_8060, 0x35_c79b),
    shade("noise", Color::NOISE, 0x5a_626b, 0xa7_b0b9),
    shade("ochre", Color::OCHRE, 0xa0_6f00, 0xe6_b53c),
    shade("sky", Color::SKY, 0x32_86bb, 0x8f_d0f5),
    shade("muted", Color::MUTED, 0x73_7c86, 0x8f_99a3),
    shade("good", Color::GOOD, 0x3d_7a1f, 0x8f_ce5c),
    shade("amber", Color::DOUBTFUL, 0x8a_5d00, 0xe0_a030),
    shade("bad", Color::BAD, 0xb8_3227, 0xf0_776b),
    shade("axis-1", Color::OF_AXIS[0], 0x7a_5cc4, 0xb4_9ef0),
    shade("axis-2", Color::OF_AXIS[1], 0x94_6200, 0xd8_bd62),
    shade("axis-3", Color::OF_AXIS[2], 0x3f_7f88, 0x8f_c3ca),
    shade("axis-4", Color::OF_AXIS[3], 0xb0_578a, 0xe0_9cc3),
];

/// The palette as variables of a page's style, `--measured` and so on; on a dark screen lines of pictures have them, too.
pub(crate) fn style() -> String {
    let variables = |of: fn(&Shade) -> Color| SHADES.iter().map(move |s| format!(" --{}: {};", s.name, of(s).hex()));
    let mut css = format!(":root {{{} }}\n", variables(|s| s.light).collect::<String>());
    let dark: String = variables(|s| s.dark).collect();
    let _ = writeln!(css, "@media screen and (prefers-color-scheme: dark) {{\n  :root:not(.paper) {{{dark} }}");
    for s in &SHADES {
        let _ =
            writeln!(css, "  figure svg [stroke='{}'] {{ stroke: var(--{}); }}", s.paper.hex().to_uppercase(), s.name);
    }
    css + "}\n"
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
    fn stages_have_colours_of_their_own_that_are_seen_on_every_ground() {
        let roles = [Role::Nominal, Role::Identified, Role::Earlier, Role::Added];
        let names: Vec<&str> = roles.iter().map(|r| r.class()).collect();
        assert_eq!(names, ["nominal", "identified", "earlier", "added"]);
        let contrast = |a: Color, b: Color| {
            let (a, b) = (a.luminance() + 0.05, b.luminance() + 0.05);
            a.max(b) / a.min(b)
        };
        for s in &SHADES {
            assert!(contrast(s.light, WHITE) >= 3.0 && contrast(s.dark, Color(0x14, 0x17, 0x1a)) >= 3.0, "{}", s.name);
        }
        let css = style();
        assert!(css.starts_with(":root { --measured: #3b3b3b; --nominal: #c65500;"), "{css}");
        assert!(css.contains("figure svg [stroke='#D55E00'] { stroke: var(--nominal); }"), "{css}");
    }

    #[test]
    fn the_ink_on_every_colour_has_the_contrast_for_small_text() {
        let contrast = |a: Color, b: Color| {
            let (a, b) = (a.luminance() + 0.05, b.luminance() + 0.05);
            a.max(b) / a.min(b)
        };
        // The examples of WCAG: black on white 21, #777 on white 4.48.
        assert!((contrast(Color(0, 0, 0), WHITE) - 21.0).abs() < 1e-9);
        assert!((contrast(Color(0x77, 0x77, 0x77), WHITE) - 4.48).abs() < 0.005);
        for color in Color::CYCLE.into_iter().chain([Color::MUTED]) {
            for strength in [0.15, 0.5, 0.8, 1.0] {
                let pale = color.pale(strength);
                assert!(contrast(pale, pale.ink()) > 4.5, "{pale:?}");
            }
        }
    }
}
