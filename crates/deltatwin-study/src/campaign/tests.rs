//! Campaigns in a temporary folder: chunks, interruptions, what is missing.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use super::table::Kind;
use super::*;

struct Silent(AtomicU64, u64);

impl Watch for Silent {
    fn row(&self, _: &[Value], anew: bool) {
        self.0.fetch_add(u64::from(anew), Ordering::Relaxed);
    }

    fn stop(&self) -> bool {
        self.0.load(Ordering::Relaxed) >= self.1
    }
}

fn watch(most: u64) -> Silent {
    Silent(AtomicU64::new(0), most)
}

fn campaign(folder: &Path) -> Campaign {
    let headings = vec![Heading::new("run", "1", Kind::Integer), Heading::new("x", "m", Kind::Float)];
    let digest = Digest::of([("test", &b"1"[..])]);
    let metadata = vec![("study".into(), "text".into())];
    Campaign { name: "own".into(), folder: folder.into(), digest, build: BUILD.into(), headings, metadata }
}

fn work(run: u64) -> Row {
    Ok(vec![Value::Integer(run as i64), Value::Float((run as f64).sin())])
}

fn merged(runs: u64, chunks: &[(u64, u64)]) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let campaign = campaign(folder.path());
    for (number, of) in chunks {
        let chunk = Chunk::new(*number, *of).unwrap();
        campaign.chunk(chunk, runs, &work, &watch(u64::MAX)).unwrap();
    }
    assert_eq!(campaign.merge(Some(runs)).unwrap(), runs);
    assert_eq!(campaign.held().unwrap(), Held::Table);
    std::fs::read(campaign.table()).unwrap()
}

#[test]
fn the_table_does_not_depend_on_the_chunks() {
    for runs in [0, 5, 9000] {
        let one = merged(runs, &[(1, 1)]);
        assert_eq!(one, merged(runs, &[(2, 2), (1, 2)]));
        assert_eq!(one, merged(runs, &[(7, 7), (1, 7), (2, 7), (6, 7), (3, 7), (5, 7), (4, 7)]));
        // Halves and thirds that overlap.
        assert_eq!(one, merged(runs, &[(1, 2), (2, 3), (3, 3)]));
    }
}

#[test]
fn a_stopped_chunk_goes_on_where_it_was() {
    let whole = merged(500, &[(1, 1)]);
    let folder = tempfile::tempdir().unwrap();
    let campaign = campaign(folder.path());
    let mut made = 0;
    loop {
        let watch = watch(37);
        let end = campaign.chunk(Chunk::WHOLE, 500, &work, &watch);
        made += watch.0.load(Ordering::Relaxed);
        match end {
            Ok(()) => break,
            Err(CampaignError::Interrupted) => assert!(!campaign.part(Chunk::WHOLE).exists()),
            Err(e) => panic!("{e}"),
        }
    }
    assert_eq!(made, 500);
    campaign.merge(Some(500)).unwrap();
    assert_eq!(std::fs::read(campaign.table()).unwrap(), whole);
}

#[test]
fn what_is_missing_or_foreign_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let campaign = campaign(folder.path());
    for number in [1, 2, 4] {
        campaign.chunk(Chunk::new(number, 4).unwrap(), 10, &work, &watch(u64::MAX)).unwrap();
    }
    match campaign.merge(Some(10)) {
        Err(CampaignError::Incomplete { missing: 2, of: 10, first: 5, chunks, .. }) => {
            assert_eq!(chunks, [Chunk::new(3, 4).unwrap()]);
        }
        other => panic!("{other:?}"),
    }
    let other = Campaign { digest: Digest::of([]), ..self::campaign(folder.path()) };
    assert!(matches!(other.merge(Some(10)), Err(CampaignError::Foreign { .. })));
    let chunk = Chunk::new(1, 4).unwrap();
    assert!(matches!(other.chunk(chunk, 10, &work, &watch(9)), Err(CampaignError::Foreign { .. })));
    std::fs::write(campaign.part(Chunk::new(3, 4).unwrap()), "PAR1").unwrap();
    assert!(matches!(campaign.merge(Some(10)), Err(CampaignError::Content { .. })));
    other.clear().unwrap();
    assert!(matches!(campaign.merge(Some(10)), Err(CampaignError::Incomplete { missing: 10, .. })));
}

/// A folder with a third of a study refuses another one before its first run, and loses nothing.
#[test]
fn a_folder_is_of_one_study_from_the_first_moment() {
    let whole = merged(9, &[(1, 1)]);
    let folder = tempfile::tempdir().unwrap();
    let own = campaign(folder.path());
    let other = Campaign { name: "other".into(), digest: Digest::of([]), ..campaign(folder.path()) };
    let [first, second, third] = [1, 2, 3].map(|k| Chunk::new(k, 3).unwrap());
    let never = |run: u64| -> Row { panic!("run {run} was made") };
    let refused = |chunk: Chunk| {
        let error = other.chunk(chunk, 9, &never, &watch(u64::MAX)).unwrap_err();
        assert!(matches!(error, CampaignError::Foreign { .. }), "{error}");
        let text = error.to_string();
        assert!(text.contains("own (digest ") && text.contains("this one is other (digest "), "{text}");
    };
    // Before a part is there: the first study ended within its first chunk.
    let broken = |run: u64| if run == 1 { Err("no disk".into()) } else { work(run) };
    assert!(matches!(own.chunk(first, 9, &broken, &watch(u64::MAX)), Err(CampaignError::Run { run: 1, .. })));
    [Chunk::WHOLE, first, second].into_iter().for_each(refused);
    own.chunk(first, 9, &work, &watch(u64::MAX)).unwrap();
    [Chunk::WHOLE, first, second].into_iter().for_each(refused);
    // Parts that were brought from elsewhere, without the file that states whose they are.
    std::fs::remove_file(folder.path().join("parts/.study")).unwrap();
    refused(second);
    for chunk in [second, third] {
        own.chunk(chunk, 9, &work, &watch(u64::MAX)).unwrap();
    }
    own.merge(Some(9)).unwrap();
    own.remove_parts().unwrap();
    assert_eq!(std::fs::read(own.table()).unwrap(), whole);
    refused(second);
    assert!(!folder.path().join("parts").exists());
}

#[test]
fn rows_of_two_builds_are_not_mixed() {
    // The name is a SHA-256.
    assert!(BUILD.len() == 64 && BUILD.bytes().all(|b| b.is_ascii_hexdigit()), "{BUILD}");
    let folder = tempfile::tempdir().unwrap();
    let (own, other) = (campaign(folder.path()), Campaign { build: "0".repeat(64), ..campaign(folder.path()) });
    let [first, second] = [1, 2].map(|k| Chunk::new(k, 2).unwrap());
    own.chunk(first, 10, &work, &watch(u64::MAX)).unwrap();
    // A part, a journal, the whole and the table.
    let refused = |end: Result<(), CampaignError>| match end {
        Err(error @ CampaignError::OtherBuild { .. }) => assert!(error.to_string().contains(&BUILD[..12]), "{error}"),
        end => panic!("{end:?}"),
    };
    refused(other.chunk(first, 10, &work, &watch(u64::MAX)));
    let broken = |run: u64| if run == 7 { Err("no disk".into()) } else { work(run) };
    assert!(matches!(own.chunk(second, 10, &broken, &watch(u64::MAX)), Err(CampaignError::Run { run: 7, .. })));
    refused(other.chunk(second, 10, &work, &watch(u64::MAX)));
    own.chunk(second, 10, &work, &watch(u64::MAX)).unwrap();
    refused(other.merge(Some(10)).map(drop));
    own.merge(Some(10)).unwrap();
    refused(other.held().map(drop));
    assert_eq!(own.held().unwrap(), Held::Table);
}

#[test]
fn an_error_of_a_run_ends_the_chunk_and_keeps_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let campaign = campaign(folder.path());
    let broken = |run: u64| if run == 7 { Err("no disk".into()) } else { work(run) };
    let end = campaign.chunk(Chunk::WHOLE, 100, &broken, &watch(u64::MAX));
    assert!(matches!(end, Err(CampaignError::Run { run: 7, .. })), "{end:?}");
    campaign.chunk(Chunk::WHOLE, 100, &work, &watch(u64::MAX)).unwrap();
    assert_eq!(campaign.merge(Some(100)).unwrap(), 100);
}

#[test]
fn a_sequence_takes_its_rows_from_the_journal() {
    // Each run depends on the one before: x ← sin(x + run).
    let folder = tempfile::tempdir().unwrap();
    let campaign = campaign(folder.path());
    let search = |steps: &mut Steps| -> Result<(), CampaignError> {
        let mut x = 0.5;
        for _ in 0..40 {
            let rows = steps.batch(3, &|run, k| {
                Ok(vec![Value::Integer(run as i64), Value::Float(f64::sin(x + run as f64 + k as f64))])
            })?;
            x = rows[2][1].number().unwrap();
        }
        Ok(())
    };
    let mut stops = 0;
    while let Err(e) = campaign.sequence(&watch(20), search) {
        assert!(matches!(e, CampaignError::Interrupted));
        stops += 1;
    }
    assert!(stops > 3);
    assert_eq!(campaign.merge(None).unwrap(), 120);
    let folder = tempfile::tempdir().unwrap();
    let whole = self::campaign(folder.path());
    whole.sequence(&watch(u64::MAX), search).unwrap();
    whole.merge(None).unwrap();
    assert_eq!(std::fs::read(campaign.table()).unwrap(), std::fs::read(whole.table()).unwrap());
}

/// The caller is the only thread that could make the runs.
#[test]
fn a_chunk_is_made_within_a_pool_of_one_thread() {
    let whole = merged(300, &[(1, 1)]);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(pool.install(|| merged(300, &[(1, 1)])), whole);
}
