//! Damaged and hostile bags, and recordings whose writer was killed.

use std::fs;
use std::io::Read;
use std::path::Path;

use deltatwin::recording::{Context, Recording};
use deltatwin_io::recording::{self, Head, Reading, Recorder};

use super::{folder, read, run};

/// Largest number of samples in a chunk: 64 KiB of messages of the recordings of [`run`].
const CHUNK: usize = 400;

#[test]
#[ignore = "campaign"]
fn one_flipped_byte_costs_at_most_its_chunk() {
    let folder = folder();
    let path = folder.path().join("run.mcap");
    let whole = run(6_000);
    recording::write(&whole, &path).unwrap();
    let bytes = fs::read(&path).unwrap();
    let mut lossless = 0;
    for k in 0..120 {
        // Behind the setup, whose loss is another matter.
        let at = 2_000 + k * (bytes.len() - 2_100) / 120;
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x10;
        fs::write(&path, damaged).unwrap();
        let (part, warnings) = read(&path);
        let lost = whole.signals.len() - part.signals.len();
        assert!(lost <= CHUNK, "byte {at}: {lost} samples lost, {warnings:?}");
        lossless += usize::from(lost == 0);
        if lost > 0 {
            let counted = format!("{lost} of 6000 of `/joint_states`");
            assert!(warnings.iter().any(|w| w.contains(&counted)), "byte {at}: {lost} lost, {warnings:?}");
            assert!(warnings.iter().any(|w| w.contains("damaged") && w.contains(" s to ")), "{warnings:?}");
        }
    }
    assert!(lossless < 60, "hardly any byte mattered");
}

#[test]
fn damage_in_a_file_that_is_cut_short_costs_its_chunk_too() {
    let folder = folder();
    let path = folder.path().join("run.mcap");
    recording::write(&run(3_000), &path).unwrap();
    let mut bytes = fs::read(&path).unwrap();
    bytes.truncate(bytes.len() * 8 / 10);
    fs::write(&path, &bytes).unwrap();
    let before = read(&path).0.signals.len();
    let mut most = 0;
    for k in 2..8 {
        let mut damaged = bytes.clone();
        // A whole stretch, as of a bad sector.
        let at = k * bytes.len() / 10;
        damaged[at..at + 512].fill(0);
        fs::write(&path, damaged).unwrap();
        let (part, warnings) = read(&path);
        let lost = before - part.signals.len();
        assert!(lost <= 2 * CHUNK, "{lost} lost: {warnings:?}");
        most = most.max(lost);
    }
    assert!(most > 0, "no chunk was hit");
}

/// Bytes of each chunk of an MCAP file with the indexes of its messages behind it.
fn chunks(bytes: &[u8]) -> Vec<std::ops::Range<usize>> {
    let mut found: Vec<std::ops::Range<usize>> = Vec::new();
    let mut at = 8;
    while at + 9 <= bytes.len() - 8 {
        let end = at + 9 + u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        match (bytes[at], found.last_mut()) {
            (0x06, _) => found.push(at..end),
            (0x07, Some(last)) if last.end == at => last.end = end,
            _ => {}
        }
        at = end;
    }
    found
}

#[test]
fn chunks_that_are_swapped_or_doubled_are_put_in_order() {
    let folder = folder();
    let path = folder.path().join("run.mcap");
    let whole = run(3_000);
    recording::write(&whole, &path).unwrap();
    let bytes = fs::read(&path).unwrap();
    let chunks = chunks(&bytes);
    assert!(chunks.len() > 6, "{chunks:?}");
    let (first, second) = (chunks[3].clone(), chunks[4].clone());
    assert_eq!(first.end, second.start);
    let [before, a, b, after] =
        [&bytes[..first.start], &bytes[first.clone()], &bytes[second.clone()], &bytes[second.end..]];
    for (parts, why) in [
        ([before, b, a, after].concat(), "sorted by their log times"),
        ([before, a, a, b, after].concat(), "samples repeat the one before"),
        ([before, a, b, a, after].concat(), "samples repeat the one before"),
    ] {
        fs::write(&path, parts).unwrap();
        let (back, warnings) = read(&path);
        assert!(back.signals == whole.signals, "{warnings:?}");
        assert!(warnings.iter().any(|w| w.contains(why)), "{why}: {warnings:?}");
    }
}

#[test]
fn damaged_first_or_last_bytes_cost_a_warning() {
    let folder = folder();
    let whole = run(300);
    let name = folder.path().join("run.mcap");
    recording::write(&whole, &name).unwrap();
    let bytes = fs::read(&name).unwrap();
    let last = bytes.len() - 8;
    // By its content alone, too.
    for path in [name, folder.path().join("run")] {
        for place in (0..8).chain(last..bytes.len()) {
            let mut damaged = bytes.clone();
            damaged[place] ^= 0x20;
            fs::write(&path, damaged).unwrap();
            let (back, warnings) = read(&path);
            assert!(back.signals == whole.signals, "byte {place}: {warnings:?}");
            assert!(place >= last || warnings.iter().any(|w| w.contains("first bytes are damaged")), "{warnings:?}");
        }
    }
}

/// An MCAP file of records given as opcode and body.
fn mcap_of(records: &[(u8, Vec<u8>)]) -> Vec<u8> {
    let mut out = b"\x89MCAP0\r\n".to_vec();
    for (opcode, body) in records {
        out.push(*opcode);
        out.extend((body.len() as u64).to_le_bytes());
        out.extend(body);
    }
    out
}

fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}

fn channel(id: u16, topic: &str) -> (u8, Vec<u8>) {
    (0x04, [&id.to_le_bytes()[..], &1u16.to_le_bytes(), &text(topic), &text("cdr"), &[0; 4]].concat())
}

fn chunk(stated: u64, compression: &str, records: &[u8]) -> (u8, Vec<u8>) {
    let size = (records.len() as u64).to_le_bytes();
    let head = [&[0; 16][..], &stated.to_le_bytes(), &[0; 4], &text(compression), &size].concat();
    (0x06, [head, records.to_vec()].concat())
}

/// The error for a file of these records, which allocates at most `most` bytes.
fn refused(name: &str, records: &[(u8, Vec<u8>)]) -> String {
    let folder = folder();
    let path = folder.path().join(format!("{name}.mcap"));
    fs::write(&path, mcap_of(records)).unwrap();
    recording::read(&path, None).unwrap_err().to_string()
}

#[test]
fn sizes_that_lie_and_bombs_are_left_out() {
    let schema =
        (0x03, [&1u16.to_le_bytes()[..], &text("sensor_msgs/msg/JointState"), &text("ros2msg"), &[0; 4]].concat());
    for stated in [0, 1, 1 << 40, u64::MAX, u64::MAX - 64] {
        let e = refused("lie", &[schema.clone(), channel(1, "/joint_states"), chunk(stated, "zstd", &[7; 100])]);
        assert!(e.contains("JointState"), "{e}");
        let e = refused("lie", &[schema.clone(), channel(1, "/joint_states"), chunk(stated, "", &[7; 100])]);
        assert!(e.contains("JointState"), "{e}");
    }
    // A quarter of a gigabyte of zeros in 8 kB.
    let zeros = zstd::encode_all(std::io::repeat(0).take(1 << 28), 3).unwrap();
    let e = refused("bomb", &[schema, channel(1, "/joint_states"), chunk(1 << 28, "zstd", &zeros)]);
    assert!(e.contains("cut short or damaged"), "{e}");
}

#[test]
fn a_hundred_thousand_topics_are_no_matter() {
    let records: Vec<_> = (0..100_000).map(|k| channel(k as u16, &format!("/a/topic/of/some/length/{k}"))).collect();
    let start = std::time::Instant::now();
    let e = refused("topics", &records);
    assert!(start.elapsed().as_secs() < 5, "{:?}", start.elapsed());
    assert!(e.contains("and 99980 more") && e.len() < 2_000, "{e}");
}

#[test]
fn memory_is_bounded_on_request() {
    let folder = folder();
    let path = folder.path().join("run.mcap");
    recording::write(&run(6_000), &path).unwrap();
    let how = Reading { max_memory: Some(1 << 20), ..Reading::default() };
    let e = recording::read_as(&path, &how).unwrap_err().to_string();
    assert!(e.contains("--max-memory") && e.contains("run.mcap"), "{e}");
    let how = Reading { max_memory: Some(100 << 20), ..Reading::default() };
    assert_eq!(recording::read_as(&path, &how).unwrap().0.signals.len(), 6_000);
}

#[test]
fn past_crashers_are_read_or_refused() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/files/corpus");
    let mut tried = 0;
    for entry in fs::read_dir(corpus).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "mcap" || e == "csv" || e == "db3") {
            let _ = recording::read(&path, None);
            tried += 1;
        }
    }
    assert!(tried > 0);
}

/// Appends `whole` in pieces; calls `look` after each with the number of samples so far.
fn record(whole: &Recording, target: &Path, look: &mut dyn FnMut(&Path, usize)) {
    let context = Context::default();
    let head = Head { mechanism: whole.signals.mechanism, start: None, setup: &whole.setup, context: &context };
    let mut recorder = Recorder::create(target, &head).unwrap();
    let partial = recorder.partial().to_path_buf();
    let mut rest = whole.signals.clone();
    let mut samples = 0;
    while !rest.is_empty() {
        let piece = rest.split_off_front(500.min(rest.len()));
        samples += piece.len();
        recorder.append(&piece, &[], &[], &[]).unwrap();
        recorder.keep().unwrap();
        look(&partial, samples);
    }
    assert!(!target.exists());
    recorder.finish().unwrap();
    assert!(!partial.exists());
}

#[test]
fn a_recording_is_on_the_disk_while_it_is_made() {
    let folder = folder();
    let whole = run(2_000);
    for name in ["run.mcap", "run.csv"] {
        let target = folder.path().join(name);
        record(&whole, &target, &mut |partial, samples| {
            // As after the end of the process: nothing of what was kept is missing.
            let (part, warnings) = recording::read(partial, None).unwrap();
            assert_eq!(part.signals.len(), samples, "{name}: {warnings:?}");
            assert!(part.signals.q() == whole.signals.part(0..samples).q(), "{name}");
            assert_eq!(part.setup, whole.setup);
        });
        let (back, warnings) = read(&target);
        assert!(back.signals.q() == whole.signals.q() && back.setup == whole.setup, "{name}");
        assert!(warnings.iter().all(|w| !w.contains("cut short") && !w.contains("damaged")), "{name}: {warnings:?}");
    }
}

#[test]
fn pieces_make_the_same_file_as_the_whole() {
    let folder = folder();
    let whole = run(1_200);
    let context = Context::default();
    for name in ["run.mcap", "run.csv"] {
        let files = [1, 7, 1_200].map(|pieces| {
            let target = folder.path().join(format!("{pieces}-{name}"));
            let head = Head { mechanism: whole.signals.mechanism, start: None, setup: &whole.setup, context: &context };
            let mut recorder = Recorder::create(&target, &head).unwrap();
            let mut rest = whole.signals.clone();
            while !rest.is_empty() {
                let piece = rest.split_off_front(whole.signals.len().div_ceil(pieces).min(rest.len()));
                recorder.append(&piece, &[], &[], &[]).unwrap();
            }
            recorder.finish().unwrap();
            fs::read(target).unwrap()
        });
        assert!(files[0] == files[1] && files[0] == files[2], "{name}");
    }
}

#[test]
fn two_writers_of_one_recording_do_not_mix() {
    let folder = folder();
    let target = folder.path().join("run.mcap");
    let whole = run(1_000);
    let context = Context::default();
    let head = Head { mechanism: whole.signals.mechanism, start: None, setup: &whole.setup, context: &context };
    let mut both = [Recorder::create(&target, &head).unwrap(), Recorder::create(&target, &head).unwrap()];
    let mut rest = whole.signals.clone();
    while !rest.is_empty() {
        let piece = rest.split_off_front(100);
        both.iter_mut().for_each(|recorder| recorder.append(&piece, &[], &[], &[]).unwrap());
    }
    for recorder in both {
        recorder.finish().unwrap();
        assert_eq!(read(&target).0.signals.q(), whole.signals.q());
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}
