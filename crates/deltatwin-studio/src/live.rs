//! A machine that runs, watched by `deltatwin watch` in a process of its own: its answers as they come.

use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{ChildStdin, Command, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use deltatwin_analysis::page::quoted;
use miette::{IntoDiagnostic, WrapErr};
use serde_json::{Value, json};

/// Most answers that are kept for windows that open later: three hours of two per second.
const MOST: usize = 20_000;
/// Most answers that a window gets at once.
const AT_ONCE: usize = 2_000;
/// Most lines of remarks that are kept.
const REMARKS: usize = 20;

/// A watch, which ends when this is dropped.
pub(crate) struct Live {
    /// The command that does the same.
    command: String,
    /// The watch ends with it.
    input: Mutex<Option<ChildStdin>>,
    heard: Arc<Mutex<Heard>>,
}

#[derive(Default)]
struct Heard {
    /// Number of answers before the first of the list.
    forgotten: usize,
    answers: VecDeque<Value>,
    verdict: Value,
    remarks: VecDeque<String>,
    /// Exit status, once the watch has ended; -1 if a signal ended it.
    status: Option<i32>,
}

fn locked(heard: &Mutex<Heard>) -> MutexGuard<'_, Heard> {
    heard.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Live {
    /// Starts `program` with `words` and `--answers` in `folder`.
    ///
    /// # Errors
    /// If it cannot be started.
    pub fn start(program: &Path, folder: &Path, words: &[String]) -> miette::Result<Self> {
        let mut child = Command::new(program)
            .args(words)
            .arg("--answers")
            .current_dir(folder)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .into_diagnostic()
            .wrap_err_with(|| format!("{}: cannot be started", program.display()))?;
        let heard = Arc::<Mutex<Heard>>::default();
        let (input, out, remarks) = (child.stdin.take(), child.stdout.take(), child.stderr.take());
        let notes = heard.clone();
        let aside = std::thread::spawn(move || {
            remarks.into_iter().for_each(|from| each_line(from, |line| remark(&notes, line)))
        });
        let own = heard.clone();
        std::thread::spawn(move || {
            out.into_iter().for_each(|from| each_line(from, |line| answer(&own, line)));
            let _ = aside.join();
            let status = child.wait().ok().and_then(|status| status.code()).unwrap_or(-1);
            locked(&own).status = Some(status);
        });
        let words = std::iter::once("deltatwin").chain(words.iter().map(String::as_str)).map(quoted);
        Ok(Self { command: words.collect::<Vec<_>>().join(" "), input: Mutex::new(input), heard })
    }

    /// Lets the watch end with its verdict.
    pub fn stop(&self) {
        self.input.lock().unwrap_or_else(PoisonError::into_inner).take();
    }

    /// Whether it goes on.
    pub fn is_running(&self) -> bool {
        locked(&self.heard).status.is_none()
    }

    /// Answers from number `from` on, the verdict, remarks and, at the end, the exit status.
    pub fn json(&self, from: usize) -> Value {
        let heard = locked(&self.heard);
        let first = from.max(heard.forgotten) - heard.forgotten;
        let answers: Vec<&Value> = heard.answers.iter().skip(first).take(AT_ONCE).collect();
        json!({
            "command": self.command,
            "next": heard.forgotten + first.min(heard.answers.len()) + answers.len(),
            "answers": answers,
            "verdict": heard.verdict,
            "remarks": heard.remarks,
            "status": heard.status,
        })
    }
}

/// Reads lines until there are no more.
fn each_line(from: impl Read, each: impl FnMut(String)) {
    BufReader::new(from).lines().map_while(Result::ok).for_each(each);
}

fn remark(heard: &Mutex<Heard>, line: String) {
    let mut heard = locked(heard);
    heard.remarks.push_back(line);
    if heard.remarks.len() > REMARKS {
        heard.remarks.pop_front();
    }
}

fn answer(heard: &Mutex<Heard>, line: String) {
    let Ok(mut answer) = serde_json::from_str::<Value>(&line) else { return remark(heard, line) };
    let mut heard = locked(heard);
    if answer["topic"] == "verdict" {
        heard.verdict = answer["answer"].take();
        return;
    }
    heard.answers.push_back(answer);
    if heard.answers.len() > MOST {
        heard.answers.pop_front();
        heard.forgotten += 1;
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    fn wait(live: &Live, until: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            let now = live.json(0);
            if until(&now) {
                return now;
            }
            assert!(begun.elapsed() < Duration::from_secs(20), "{now}");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    #[test]
    fn answers_are_numbered_and_the_watch_ends_with_its_input() {
        let folder = tempfile::tempdir().unwrap();
        let script = "echo '{\"topic\":\"residual\",\"answer\":{\"t\":1}}'; echo strange >&2; echo '{\"topic\":\"margins\",\"answer\":2}'; \
                      cat >/dev/null; echo '{\"topic\":\"verdict\",\"answer\":{\"state\":\"healthy\"}}'; exit 1";
        let live = Live::start(Path::new("sh"), folder.path(), &["-c".into(), script.into()]).unwrap();
        let now = wait(&live, |now| now["next"] == 2 && now["remarks"][0] == "strange");
        assert!(live.is_running() && now["verdict"].is_null() && now["answers"][0]["answer"]["t"] == 1, "{now}");
        let later = live.json(1);
        assert_eq!((&later["answers"][0]["topic"], &later["next"]), (&json!("margins"), &json!(2)));
        assert_eq!(live.json(7)["answers"], json!([]));
        live.stop();
        let end = wait(&live, |now| now["status"] == 1);
        assert_eq!(end["verdict"]["state"], "healthy");
        assert!(!live.is_running());
        assert!(Live::start(Path::new("/nothing/here"), folder.path(), &[]).is_err());
    }
}
