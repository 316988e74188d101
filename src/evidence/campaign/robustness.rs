//! Degenerate input.

use super::*;

#[test]
#[ignore = "campaign"]
fn degenerate_problems_end_in_a_status() {
    let run = |p: &Problem| select(p, &quick());
    assert_eq!(run(&Problem::default()).err(), Some(Error::Empty));
    let good = null_problem(3, false);
    let edit = |change: &dyn Fn(&mut Problem)| {
        let mut p = good.clone();
        change(&mut p);
        run(&p)
    };
    assert!(edit(&|p| p.candidates.clear()).is_ok());
    assert!(edit(&|p| p.base.clear()).is_ok());
    assert!(edit(&|p| p.candidates[2].variants[0].columns.clear()).is_ok());
    assert!(edit(&|p| p.candidates[2].variants.clear()).is_ok());
    assert!(edit(&|p| p.candidates[2] = p.candidates[3].clone()).is_ok());
    assert!(edit(&|p| p.base[1] = p.base[0].clone()).is_ok());
    assert!(edit(&|p| p.base[1].values.fill(1.0)).is_ok());
    assert!(edit(&|p| p.y[..N].fill(0.0)).is_ok());
    assert!(edit(&|p| p.y.fill(4.0)).is_ok());
    assert!(edit(&|p| p.y = p.base[0].values.clone()).unwrap().findings.is_empty());
    assert!(matches!(edit(&|p| p.y.fill(0.0)), Err(Error::Undetermined { values: 0, .. })));
    let few = edit(&|p| p.segments = vec![0..60]).unwrap();
    assert!(few.findings.is_empty() && few.remaining.too_few.is_some_and(|few| few.rows <= 60 && few.needed == 128));
    assert!(matches!(edit(&|p| p.segments = vec![0..60, 50..N]), Err(Error::Segment(1))));
    assert!(matches!(edit(&|p| p.y = p.y.window(&(0..9))), Err(Error::Length { .. })));
    assert_eq!(edit(&|p| p.y[7] = f64::NAN).err(), Some(Error::NotFinite("y".into())));
    assert_eq!(edit(&|p| p.base[3].values[9] = f64::INFINITY).err(), Some(Error::NotFinite("base 3".into())));
    let bad = edit(&|p| p.candidates[1].variants[0].columns[0].values[2000] = f64::NAN);
    assert_eq!(bad.err(), Some(Error::NotFinite("candidate 1.0".into())));
    let nowhere = [Chosen { candidate: 99, variant: 0 }];
    assert_eq!(evaluate(&good, &nowhere, &quick()).err(), Some(Error::Chosen(99)));
    let many = |p: &mut Problem| {
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        p.candidates[0].variants[0].columns = (0..40).map(|i| column(&i.to_string(), smooth(&mut rng, C, N))).collect();
    };
    assert!(edit(&many).is_ok());
    let no_draws = Settings { flips: 0, blocks: 0, max_order: 0, max_steps: 0, ..Settings::default() };
    assert!(select(&good, &no_draws).is_ok());
}
