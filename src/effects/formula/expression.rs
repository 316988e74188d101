//! Expressions of a formula, compiled to a stack program that is evaluated without allocation.
//!
//! Grammar in order of increasing precedence: `+ -`, `* /`, sign, `^` (right-associative), then numbers, names,
//! `name(…)` and `(…)`. A sign binds less than a power, −v^2 = −(v²), as in mathematical notation; this precedence and
//! error positions within the text are the reasons for a parser of its own.

use std::ops::Range;

use super::dimension::{Dimension, Yields};
use super::variables::Variable;
use crate::machine::Mechanism;
use crate::machine::unit::Powers;
use crate::text::nearest;

/// A compiled law with its text.
#[derive(Clone, Debug)]
pub struct Expression {
    text: String,
    program: Vec<Step>,
}

/// Fault of an expression, and its position.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{problem}")]
pub struct ExpressionError {
    /// Range in the text, bytes.
    pub at: Range<usize>,
    /// What was found and what was expected.
    pub problem: String,
}

/// Instruction of the stack program.
#[derive(Clone, Copy, Debug)]
enum Step {
    Number(f64),
    Variable(Variable),
    Negate,
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    PowerOf(i32),
    Call(Function),
}

#[derive(Clone, Copy, Debug)]
enum Function {
    One(fn(f64) -> f64, Yields),
    Two(fn(f64, f64) -> f64),
}

/// Sign of x; zero at zero, unlike [`f64::signum`].
fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

const FUNCTIONS: [(&str, Function); 10] = [
    ("sin", Function::One(f64::sin, Yields::Number)),
    ("cos", Function::One(f64::cos, Yields::Number)),
    ("tan", Function::One(f64::tan, Yields::Number)),
    ("tanh", Function::One(f64::tanh, Yields::Number)),
    ("exp", Function::One(f64::exp, Yields::Number)),
    ("abs", Function::One(f64::abs, Yields::Same)),
    ("sign", Function::One(sign, Yields::Number)),
    ("sqrt", Function::One(f64::sqrt, Yields::Root)),
    ("min", Function::Two(f64::min)),
    ("max", Function::Two(f64::max)),
];

const CONSTANTS: [(&str, f64); 1] = [("pi", std::f64::consts::PI)];

/// Largest stack depth of an expression.
const STACK: usize = 32;

/// Largest nesting depth of parentheses.
const NESTING: usize = 64;

impl Expression {
    /// Parses and compiles `text`.
    ///
    /// # Errors
    /// A syntax error, an unknown name, a wrong number of arguments, or an expression that exceeds the nesting or stack
    /// limit.
    pub fn parse(text: &str) -> Result<Self, ExpressionError> {
        let mut parser = Parser { text, at: 0, nesting: 0, program: Vec::new() };
        parser.sum()?;
        parser.skip_blanks();
        if parser.at < text.len() {
            return Err(parser.unexpected("an operator or the end"));
        }
        let program = parser.program;
        if depth(&program) > STACK {
            let problem = format!("keeps more than {STACK} numbers at a time; expected a simpler law");
            return Err(ExpressionError { at: 0..text.len(), problem });
        }
        Ok(Self { text: text.trim().into(), program })
    }

    /// Text of the expression.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Value for the variables given by `read`.
    pub fn value(&self, mut read: impl FnMut(Variable) -> f64) -> f64 {
        let mut stack = [0.0; STACK];
        let mut top = 0;
        for step in &self.program {
            if let Step::Number(_) | Step::Variable(_) = step {
                stack[top] = match step {
                    Step::Variable(v) => read(*v),
                    Step::Number(x) => *x,
                    _ => 0.0,
                };
                top += 1;
                continue;
            }
            let last = stack[top - 1];
            if let Some(of_one) = of_one(step, last) {
                stack[top - 1] = of_one;
                continue;
            }
            top -= 1;
            let before = &mut stack[top - 1];
            *before = match step {
                Step::Add => *before + last,
                Step::Subtract => *before - last,
                Step::Multiply => *before * last,
                Step::Divide => *before / last,
                Step::Power => before.powf(last),
                Step::Call(Function::Two(f)) => f(*before, last),
                _ => last,
            };
        }
        stack[0]
    }

    /// Unit of the value on `machine` as powers of N, A, m, s and rad; `None` if undetermined.
    pub fn powers(&self, machine: Mechanism) -> Option<Powers> {
        let mut stack: Vec<Dimension> = Vec::new();
        for step in &self.program {
            let last = match step {
                Step::Number(_) | Step::Variable(_) => None,
                _ => stack.pop(),
            };
            let next = match (step, last) {
                (Step::Number(x), _) => Dimension::Number(*x),
                (Step::Variable(v), _) => Dimension::Of(v.powers(machine)),
                (_, None) => return None,
                (Step::Negate, Some(x)) => x.map(|x| -x),
                (Step::PowerOf(n), Some(x)) => x.to_the(Dimension::Number(f64::from(*n))),
                (Step::Call(Function::One(f, yields)), Some(x)) => x.of(*f, *yields),
                (_, Some(x)) => {
                    let before = stack.pop()?;
                    match step {
                        Step::Multiply => before.times(x),
                        Step::Divide => before.over(x),
                        Step::Power => before.to_the(x),
                        Step::Subtract => before.with(x, |a, b| a - b),
                        Step::Call(Function::Two(f)) => before.with(x, f),
                        _ => before.with(x, |a, b| a + b),
                    }
                }
            };
            stack.push(next);
        }
        stack.pop()?.powers()
    }

    /// Variables that occur in it, in order of occurrence.
    pub fn variables(&self) -> impl Iterator<Item = Variable> {
        self.program.iter().filter_map(|s| if let Step::Variable(v) = s { Some(*v) } else { None })
    }
}

/// Result of an instruction with one operand; `None` for another instruction.
fn of_one(step: &Step, x: f64) -> Option<f64> {
    match step {
        Step::Negate => Some(-x),
        Step::PowerOf(n) => Some(x.powi(*n)),
        Step::Call(Function::One(f, _)) => Some(f(x)),
        _ => None,
    }
}

/// Stack depth that a program needs.
fn depth(program: &[Step]) -> usize {
    let (mut now, mut most) = (0, 0);
    for step in program {
        match step {
            Step::Number(_) | Step::Variable(_) => now += 1,
            _ if of_one(step, 0.0).is_some() => {}
            _ => now -= 1,
        }
        most = most.max(now);
    }
    most
}

struct Parser<'a> {
    text: &'a str,
    at: usize,
    nesting: usize,
    program: Vec<Step>,
}

impl Parser<'_> {
    fn skip_blanks(&mut self) {
        let rest = &self.text[self.at..];
        self.at += rest.len() - rest.trim_start().len();
    }

    fn peek(&mut self) -> Option<char> {
        self.skip_blanks();
        self.text[self.at..].chars().next()
    }

    /// Consumes `wanted` if it is next; returns whether it was.
    fn take(&mut self, wanted: char) -> bool {
        let found = self.peek() == Some(wanted);
        self.at += if found { wanted.len_utf8() } else { 0 };
        found
    }

    fn unexpected(&mut self, expected: &str) -> ExpressionError {
        let (at, problem) = match self.peek() {
            Some(c) => (self.at..self.at + c.len_utf8(), format!("found `{c}`, expected {expected}")),
            None => (self.at..self.at, format!("ends too early, expected {expected}")),
        };
        ExpressionError { at, problem }
    }

    fn sum(&mut self) -> Result<(), ExpressionError> {
        self.nesting += 1;
        if self.nesting > NESTING {
            let problem = format!("nests more than {NESTING} deep; expected a simpler law");
            return Err(ExpressionError { at: self.at..self.at, problem });
        }
        self.product()?;
        loop {
            let step = match () {
                () if self.take('+') => Step::Add,
                () if self.take('-') => Step::Subtract,
                () => break,
            };
            self.product()?;
            self.program.push(step);
        }
        self.nesting -= 1;
        Ok(())
    }

    fn product(&mut self) -> Result<(), ExpressionError> {
        self.signed()?;
        loop {
            let step = match () {
                () if self.take('*') => Step::Multiply,
                () if self.take('/') => Step::Divide,
                () => return Ok(()),
            };
            self.signed()?;
            self.program.push(step);
        }
    }

    fn signed(&mut self) -> Result<(), ExpressionError> {
        let mut negative = false;
        loop {
            match () {
                () if self.take('-') => negative = !negative,
                () if self.take('+') => {}
                () => break,
            }
        }
        self.power()?;
        if negative {
            self.program.push(Step::Negate);
        }
        Ok(())
    }

    fn power(&mut self) -> Result<(), ExpressionError> {
        self.atom()?;
        if !self.take('^') {
            return Ok(());
        }
        self.nesting += 1;
        if self.nesting > NESTING {
            let problem = format!("nests more than {NESTING} deep; expected a simpler law");
            return Err(ExpressionError { at: self.at..self.at, problem });
        }
        let exponent = self.program.len();
        self.signed()?;
        self.nesting -= 1;
        // An integer exponent is evaluated by `powi`, exact and fast.
        let whole = match self.program[exponent..] {
            [Step::Number(x)] => Some(x),
            [Step::Number(x), Step::Negate] => Some(-x),
            _ => None,
        };
        match whole.filter(|x| x.fract() == 0.0 && x.abs() <= 64.0) {
            Some(x) => {
                self.program.truncate(exponent);
                self.program.push(Step::PowerOf(x as i32));
            }
            None => self.program.push(Step::Power),
        }
        Ok(())
    }

    fn atom(&mut self) -> Result<(), ExpressionError> {
        match self.peek() {
            Some('(') => {
                self.take('(');
                self.sum()?;
                self.close()
            }
            Some(c) if c.is_ascii_digit() || c == '.' => self.number(),
            Some(c) if c.is_alphabetic() || c == '_' => self.name(),
            _ => Err(self.unexpected("a number, a variable, a function or `(`")),
        }
    }

    fn close(&mut self) -> Result<(), ExpressionError> {
        if self.take(')') { Ok(()) } else { Err(self.unexpected("an operator or `)`")) }
    }

    fn number(&mut self) -> Result<(), ExpressionError> {
        let rest = &self.text.as_bytes()[self.at..];
        let digits = |from: usize| rest[from..].iter().take_while(|b| b.is_ascii_digit()).count();
        let mut length = digits(0);
        if rest.get(length) == Some(&b'.') {
            length += 1 + digits(length + 1);
        }
        if let Some(b'e' | b'E') = rest.get(length) {
            let sign = usize::from(matches!(rest.get(length + 1), Some(b'+' | b'-')));
            let exponent = digits(length + 1 + sign);
            length += if exponent > 0 { 1 + sign + exponent } else { 0 };
        }
        let at = self.at..self.at + length;
        match self.text[at.clone()].parse::<f64>() {
            Ok(x) if x.is_finite() => {
                self.at = at.end;
                self.program.push(Step::Number(x));
                Ok(())
            }
            _ => {
                let problem = format!("`{}` is no number; expected one like 1.5 or 2e-3", &self.text[at.clone()]);
                Err(ExpressionError { at, problem })
            }
        }
    }

    fn name(&mut self) -> Result<(), ExpressionError> {
        let rest = &self.text[self.at..];
        let length = rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len());
        let (at, name) = (self.at..self.at + length, &rest[..length]);
        self.at = at.end;
        if self.peek() == Some('(') {
            let function = FUNCTIONS.iter().find(|(known, _)| *known == name).map(|(_, f)| *f);
            let function = function.ok_or_else(|| unknown("function", name, &FUNCTIONS.map(|(n, _)| n), at))?;
            self.take('(');
            self.sum()?;
            if matches!(function, Function::Two(_)) {
                if !self.take(',') {
                    return Err(self.unexpected(&format!("`,` and the second value of `{name}`")));
                }
                self.sum()?;
            }
            self.program.push(Step::Call(function));
            return self.close();
        }
        if let Some((_, value)) = CONSTANTS.iter().find(|(known, _)| *known == name) {
            self.program.push(Step::Number(*value));
            return Ok(());
        }
        let Some(variable) = Variable::named(name) else {
            let is_function = FUNCTIONS.iter().any(|(known, _)| *known == name);
            if is_function {
                return Err(self.unexpected(&format!("`(` after the function `{name}`")));
            }
            let known: Vec<&str> = Variable::names().chain(CONSTANTS.map(|(n, _)| n)).collect();
            return Err(unknown("variable", name, &known, at));
        };
        self.program.push(Step::Variable(variable));
        Ok(())
    }
}

fn unknown(what: &str, name: &str, known: &[&str], at: Range<usize>) -> ExpressionError {
    let hint = nearest(name, known.iter().copied()).map_or(String::new(), |n| format!("did you mean `{n}`? "));
    let problem = format!("unknown {what} `{name}`; {hint}expected one of {}", known.join(", "));
    ExpressionError { at, problem }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Value at q1 = 0.5 and qd1 = −3, all other variables zero.
    fn value(text: &str) -> f64 {
        let (q1, qd1) = (Variable::named("q1").unwrap(), Variable::named("qd1").unwrap());
        let read = |v: Variable| {
            if v == q1 {
                0.5
            } else if v == qd1 {
                -3.0
            } else {
                0.0
            }
        };
        Expression::parse(text).unwrap_or_else(|e| panic!("{text}: {e}")).value(read)
    }

    #[test]
    fn arithmetic_is_that_of_paper() {
        for (text, want) in [
            ("1 + 2 * 3", 7.0),
            ("-qd1^2", -9.0),
            ("2^-1", 0.5),
            ("2^3^2", 512.0),
            ("(-qd1)^2", 9.0),
            ("8 / 2 / 2", 2.0),
            ("5 - 2 - 1", 2.0),
            ("--2", 2.0),
            ("2 * -3", -6.0),
            ("2^0.5 * 2^.5", 2.0),
            ("1.5e1 + 2E-1", 15.2),
            ("sign(qd1) + sign(0) + sign(q1)", 0.0),
            ("min(q1, qd1) * max(q1, 2)", -6.0),
            ("sqrt(abs(qd1) + 6)", 3.0),
            ("cos(2*pi) + tan(0) + exp(0)", 2.0),
        ] {
            assert!((value(text) - want).abs() < 1e-14, "{text} = {}", value(text));
        }
        assert_eq!(value("-sin(33*q1) * tanh(50*qd1)"), -(16.5f64.sin()) * (-150f64).tanh());
    }

    #[test]
    fn mistakes_are_pointed_at() {
        for (text, at, says) in [
            ("sin(q5)", 4..6, "unknown variable `q5`; did you mean `q"),
            ("2 * qd_1", 4..8, "did you mean `qd1`?"),
            ("sine(q1)", 0..4, "unknown function `sine`; did you mean `sin`?"),
            ("sin q1", 4..5, "expected `(` after the function `sin`"),
            ("2 *", 3..3, "ends too early, expected a number"),
            ("(q1", 3..3, "expected an operator or `)`"),
            ("q1 q2", 3..4, "found `q`, expected an operator or the end"),
            ("min(q1)", 6..7, "expected `,` and the second value of `min`"),
            ("1e999", 0..5, "is no number"),
            ("q1 ** 2", 4..5, "found `*`"),
            ("", 0..0, "ends too early"),
            ("·", 0..2, "found `·`"),
        ] {
            let error = Expression::parse(text).unwrap_err();
            assert_eq!(error.at, at, "{text}: {error}");
            assert!(error.problem.contains(says), "{text}: {error}");
        }
    }

    #[test]
    fn depth_is_limited_without_overflow() {
        let nested = format!("{}1{}", "(".repeat(10_000), ")".repeat(10_000));
        assert!(Expression::parse(&nested).unwrap_err().problem.contains("nests"));
        let wide = format!("{}1{}", "1+(".repeat(40), ")".repeat(40));
        assert!(Expression::parse(&wide).unwrap_err().problem.contains("at a time"));
        let powers = vec!["2"; 10_000].join("^");
        assert!(Expression::parse(&powers).unwrap_err().problem.contains("nests"));
        let long = vec!["q1"; 10_000].join("+");
        assert_eq!(value(&long), 5000.0);
    }
}
