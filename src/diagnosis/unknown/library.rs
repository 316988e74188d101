//! Library of candidate laws at the places of a machine: short expressions with inner numbers on grids.

use statrs::statistics::{Data, OrderStatistics};

use crate::effects::formula::{Expression, Place, Variable};
use crate::numerics::fourier;

/// A group of terms that are added together, such as sine and cosine.
#[derive(Clone, Debug)]
pub struct Atom {
    /// Place: index into [`super::Sight::places`].
    pub place: usize,
    /// Laws, with `#` in place of the inner number.
    pub laws: Vec<String>,
    /// Inner number, if the laws have one.
    pub number: Option<Number>,
}

/// A number inside a law, refined between its neighbours on the grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Number {
    /// Present value.
    pub value: f64,
    /// Its neighbours on the grid.
    pub range: (f64, f64),
}

impl Atom {
    /// The laws as text, with `number` as the inner number.
    pub fn texts(&self, number: Option<f64>) -> Vec<String> {
        let digits = number.map_or(String::new(), short);
        self.laws.iter().map(|law| law.replace('#', &digits)).collect()
    }

    /// The laws with `number` as the inner number; `None` if one cannot be parsed.
    pub fn parsed(&self, number: Option<f64>) -> Option<Vec<Expression>> {
        self.texts(number).iter().map(|text| Expression::parse(text).ok()).collect()
    }

    /// Number of estimated values: coefficients and the inner number.
    pub fn freedom(&self) -> usize {
        self.laws.len() + usize::from(self.number.is_some())
    }
}

/// A number with five significant digits in its shortest form; negative numbers in parentheses.
pub fn short(x: f64) -> String {
    let rounded: f64 = format!("{x:.4e}").parse().unwrap_or(x);
    if rounded < 0.0 { format!("({rounded})") } else { format!("{rounded}") }
}

/// Laws of one coordinate `@` and its rate `&`, odd and even in the rate; `#` is the inner number, `~` another
/// variable.
const OWN: &[&[&str]] = &[
    &["1"],
    &["@"],
    &["@^2"],
    &["@^3"],
    &["&"],
    &["-abs(&)"],
    &["-&*abs(&)"],
    &["-&^2"],
    &["-&^3"],
    &["-@*&"],
    &["-@^2*&"],
    &["-@*tanh(50*&)"],
    &["-@^2*tanh(50*&)"],
    &["-abs(@)*tanh(50*&)"],
    &["-tanh(50*&)"],
    &["-sqrt(abs(&))*tanh(50*&)"],
    &["t"],
    &["t^2"],
    &["-t*&"],
    &["-t*tanh(50*&)"],
];

/// Laws with a velocity scale.
const SPEEDS: &[&[&str]] = &[&["-tanh(&/#)"], &["-tanh(50*&)*exp(-abs(&)/#)"]];

/// Laws with a wave number of the coordinate.
const WAVES: &[&[&str]] = &[&["sin(#*@)", "cos(#*@)"]];

/// Laws with a slow wave number.
const SLOW_WAVES: &[&[&str]] = &[&["&*sin(#*@)", "&*cos(#*@)"], &["tanh(50*&)*sin(#*@)", "tanh(50*&)*cos(#*@)"]];

/// Laws with a position along the coordinate, above or below which they act.
const PLACES: &[&[&str]] = &[&["-tanh(50*&)*max(0,@-#)"], &["-tanh(50*&)*max(0,#-@)"], &["max(0,@-#)"]];

/// Laws of the coordinate near a position, with a given width.
const BUMPS: &[&str] = &["exp(-((@-#)/{w})^2)", "-tanh(50*&)*exp(-((@-#)/{w})^2)"];

/// Laws with another variable.
const OTHERS: &[&[&str]] =
    &[&["~"], &["-~*tanh(50*&)"], &["-~*&"], &["-abs(~)"], &["~^2"], &["-abs(~)*tanh(50*&)"], &["-~*abs(~)"]];

/// Laws with the torque of the drive: friction by load and saturation.
const LOADS: &[&[&str]] = &[&["-abs(~)*tanh(50*&)"], &["-~^2*tanh(50*&)"], &["-abs(~)*&"], &["~*abs(~)"], &["~^3"]];

/// Laws with another rate: crosstalk.
const CROSS: &[&[&str]] = &[&["-&*~"], &["-abs(&*~)"], &["-tanh(50*~)"], &["-&*abs(~)"]];

/// Laws of a field at the platform; `@` its coordinate and `~` another one.
const FIELD: &[&[&str]] = &[&["@*~"], &["@*~^2"], &["~^3"], &["-&*abs(~)"]];

/// Range of the data: lowest and highest value of every variable.
pub struct Cover(Vec<(f64, f64)>);

impl Cover {
    /// Range of the variables over all instants.
    pub fn new(variables: &[Vec<f64>]) -> Self {
        let ends = |x: &Vec<f64>| x.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
        Self(variables.iter().map(ends).collect())
    }

    fn of(&self, name: &str) -> (f64, f64) {
        Variable::named(name).map_or((0.0, 0.0), |v| self.0[v.index()])
    }

    fn moves(&self, name: &str) -> bool {
        let (low, high) = self.of(name);
        high - low > 1e-9
    }
}

/// Least upper limit of the wave numbers of a drive's coordinate, per rad or m; slow drives have a higher limit.
const FASTEST_WAVE: f64 = 160.0;
/// Upper limit of the wave numbers of platform and telescope coordinates, per m.
const FASTEST_FIELD: f64 = 60.0;
/// Largest number of wave numbers of a coordinate.
const MOST_WAVES: f64 = 200.0;

/// All laws at the places of a machine.
pub fn library(places: &[Place], cover: &Cover) -> Vec<Atom> {
    let mut atoms = Vec::new();
    for (number, place) in places.iter().enumerate() {
        let mut builder = Builder { place: number, cover, atoms: &mut atoms };
        match *place {
            Place::Drive(i) => {
                let rate = format!("qd{}", i + 1);
                let (low, high) = cover.of(&rate);
                let fastest = 2.0 * std::f64::consts::TAU * FASTEST_HUM / high.max(-low).max(1e-3);
                builder.own(&format!("q{}", i + 1), &rate, fastest.max(FASTEST_WAVE));
                let rates = (1..=4).filter(|j| *j != i + 1).map(|j| format!("qd{j}"));
                for rate in rates {
                    builder.with(&format!("q{}", i + 1), &format!("qd{}", i + 1), &rate, CROSS);
                    builder.with(&format!("q{}", i + 1), &format!("qd{}", i + 1), &rate, &OTHERS[..1]);
                }
                for (a, b) in [(1, 2), (1, 3), (2, 3), (1, 4), (2, 4), (3, 4)] {
                    let (a, b) = (format!("qd{a}"), format!("qd{b}"));
                    if cover.moves(&a) && cover.moves(&b) {
                        builder.push(&[&format!("{a}*{b}")], ["", "", ""], None);
                        builder.push(&[&format!("-abs({a}*{b})")], ["", "", ""], None);
                    }
                }
                builder.with(&format!("q{}", i + 1), &rate, &format!("tau{}", i + 1), LOADS);
                let struts = [2 * i + 1, 2 * i + 2].map(|s| format!("strut{s}_upper"));
                let others = (1..=4).filter(|j| *j != i + 1).map(|j| format!("q{j}"));
                let more = ["x", "y", "z", "vz", "s"].map(String::from);
                let own = [format!("qdd{}", i + 1)];
                for other in others.chain(more).chain(own).chain(if i < 3 { struts.to_vec() } else { Vec::new() }) {
                    builder.with(&format!("q{}", i + 1), &format!("qd{}", i + 1), &other, OTHERS);
                }
            }
            Place::Platform(axis) => {
                let (own, rate) = (["x", "y", "z"][axis], ["vx", "vy", "vz"][axis]);
                builder.own(own, rate, FASTEST_FIELD);
                for other in ["x", "y", "z"].into_iter().filter(|o| *o != own) {
                    builder.with(own, rate, other, OTHERS);
                    builder.with(own, rate, other, FIELD);
                    builder.waves(other, rate, FASTEST_FIELD);
                }
                for other in ["vx", "vy", "vz"].into_iter().filter(|o| *o != rate) {
                    builder.with(own, rate, other, &OTHERS[..1]);
                    builder.with(own, rate, other, CROSS);
                    builder.with(own, rate, other, &[&["-~*abs(~)"]]);
                }
                builder.poles(own, rate);
            }
            Place::Telescope => {
                builder.own("s", "sd", FASTEST_FIELD);
                builder.with("s", "sd", "qd4", CROSS);
                builder.with("s", "sd", "z", &OTHERS[..2]);
            }
        }
    }
    atoms
}

/// Highest frequency of a disturbance in time, Hz.
const FASTEST_HUM: f64 = 60.0;
/// Number of disturbances in time per drive.
const HUMS: usize = 3;

/// Disturbances in time at the strongest spectral lines of each drive's residual; `residual` starts with the drives.
pub fn harmonic_disturbances(places: &[Place], residual: &[Vec<f64>], t: &[f64]) -> Vec<Atom> {
    let mut atoms = Vec::new();
    let steps: Vec<f64> = t.windows(2).map(|t| t[1] - t[0]).collect();
    let step = Data::new(steps).median();
    let duration = t.last().zip(t.first()).map_or(0.0, |(last, first)| last - first);
    // Gaps longer than the measured time permit no spectrum.
    if step.is_nan() || step <= 0.0 || duration > 2.0 * step * t.len() as f64 {
        return atoms;
    }
    for (place, series) in places.iter().enumerate().filter_map(|(k, p)| match p {
        Place::Drive(i) => Some((k, residual.get(*i)?)),
        _ => None,
    }) {
        let power = power(series, t, step);
        // The first two lines are the constant and half a line, slower than any harmonic disturbance.
        let line = 0.5 / (step * power.len() as f64);
        let lines: Vec<f64> = (2..power.len()).map(|k| line * k as f64).take_while(|f| *f < FASTEST_HUM).collect();
        let power = &power[power.len().min(2)..];
        let mut order: Vec<usize> = (1..lines.len().saturating_sub(1))
            .filter(|&k| power[k] > power[k - 1] && power[k] >= power[k + 1])
            .collect();
        order.sort_by(|a, b| power[*b].total_cmp(&power[*a]));
        for f in order.into_iter().take(HUMS).map(|k| lines[k]) {
            let turn = std::f64::consts::TAU;
            let number = Number { value: turn * f, range: (turn * (f - line), turn * (f + line)) };
            let laws = vec!["sin(#*t)".to_string(), "cos(#*t)".to_string()];
            atoms.push(Atom { place, laws, number: Some(number) });
        }
    }
    atoms
}

/// Power at multiples of half a line of a series at instants `t` that are about multiples of `step` (s) apart, zero
/// in gaps.
fn power(series: &[f64], t: &[f64], step: f64) -> Vec<f64> {
    let place = |at: f64| ((at - t[0]) / step).round() as usize;
    let n = t.last().map_or(0, |last| place(*last) + 1);
    let mut padded = vec![0.0; 2 * n];
    for (x, at) in series.iter().zip(t) {
        padded[place(*at)] = *x;
    }
    let mut power = fourier::power(padded);
    power.truncate(n);
    power
}

struct Builder<'a> {
    place: usize,
    cover: &'a Cover,
    atoms: &'a mut Vec<Atom>,
}

impl Builder<'_> {
    fn push(&mut self, laws: &[&str], [own, rate, other]: [&str; 3], number: Option<Number>) {
        let fill = |law: &&str| law.replace('@', own).replace('&', rate).replace('~', other);
        self.atoms.push(Atom { place: self.place, laws: laws.iter().map(fill).collect(), number });
    }

    /// Adds one atom per value of a grid.
    fn grid(&mut self, laws: &[&str], names: [&str; 3], grid: &[f64]) {
        for (i, &value) in grid.iter().enumerate() {
            let range = (grid[i.saturating_sub(1)], grid[(i + 1).min(grid.len() - 1)]);
            self.push(laws, names, Some(Number { value, range }));
        }
    }

    fn own(&mut self, own: &str, rate: &str, fastest: f64) {
        let names = [own, rate, ""];
        let (low, high) = self.cover.of(own);
        let moves = self.cover.moves(own);
        for laws in OWN.iter().filter(|laws| moves || !laws[0].contains('@')) {
            self.push(laws, names, None);
        }
        let (slowest, quickest) = self.cover.of(rate);
        let top = quickest.max(-slowest);
        let speeds: Vec<f64> = [0.01, 0.025, 0.06, 0.15, 0.4].iter().map(|share| share * top).collect();
        for laws in SPEEDS.iter().filter(|_| top > 0.0) {
            self.grid(laws, names, &speeds);
        }
        if moves {
            self.waves(own, rate, fastest);
            let inside = |n: usize| (1..n).map(|k| low + (high - low) * k as f64 / n as f64).collect::<Vec<_>>();
            for laws in PLACES {
                self.grid(laws, names, &inside(8));
            }
            for law in BUMPS {
                for share in [0.05, 0.12, 0.25] {
                    let text = law.replace("{w}", &short(share * (high - low)));
                    self.grid(&[&text], names, &inside((0.8 / share) as usize + 2));
                }
            }
        }
    }

    fn waves(&mut self, own: &str, rate: &str, fastest: f64) {
        let (low, high) = self.cover.of(own);
        // Grid step: two waves are distinguished if their phases differ by more than half a turn over the travel.
        let step = 0.75 * std::f64::consts::PI / (high - low).max(1e-3);
        let fastest = fastest.min(MOST_WAVES * step);
        let grid: Vec<f64> = (1..).map(|k| step * f64::from(k)).take_while(|w| *w <= fastest).collect();
        for laws in WAVES {
            self.grid(laws, [own, rate, ""], &grid);
        }
        for laws in SLOW_WAVES {
            self.grid(laws, [own, rate, ""], &grid[..grid.len().min(12)]);
        }
    }

    fn with(&mut self, own: &str, rate: &str, other: &str, all: &[&[&str]]) {
        for laws in all.iter().filter(|_| self.cover.moves(other) && self.cover.moves(rate)) {
            self.push(laws, [own, rate, other], None);
        }
    }

    /// Laws of attraction by a pole outside the travel.
    fn poles(&mut self, own: &str, rate: &str) {
        let (low, high) = self.cover.of(own);
        let span = (high - low).max(1e-3);
        let below: Vec<f64> = [0.15, 0.4, 0.8, 1.6].iter().map(|share| low - share * span).collect();
        let above: Vec<f64> = [0.15, 0.4, 0.8, 1.6].iter().map(|share| high + share * span).collect();
        self.grid(&["1/(@-#)^2"], [own, rate, ""], &below);
        self.grid(&["1/(@-#)^2"], [own, rate, ""], &above);
    }
}
