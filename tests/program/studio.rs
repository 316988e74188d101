//! The studio's server: who may ask, what a stranger's files change, and that a killed server loses nothing.

use crate::common;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tempfile::TempDir;

/// A running studio.
struct Studio {
    process: Child,
    host: String,
    token: String,
}

impl Studio {
    fn open(folder: &Path) -> Self {
        let mut process = Command::new(env!("CARGO_BIN_EXE_deltatwin"))
            .args(["studio", &folder.display().to_string(), "--json"])
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(process.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let answer: Value = serde_json::from_str(&line).unwrap();
        let url = answer["url"].as_str().unwrap().strip_prefix("http://").unwrap().to_string();
        let (host, token) = url.split_once("/?token=").unwrap();
        Self { process, host: host.into(), token: token.into() }
    }

    /// Status and body of the answer to a request.
    fn ask(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> (u16, String) {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        let mut head = format!("{method} {path} HTTP/1.1\r\nConnection: close\r\nContent-Length: {}\r\n", body.len());
        headers.iter().for_each(|(name, value)| head += &format!("{name}: {value}\r\n"));
        if !headers.iter().any(|(name, _)| *name == "Host") {
            head += &format!("Host: {}\r\n", self.host);
        }
        stream.write_all((head + "\r\n").as_bytes()).unwrap();
        // A refused request may not be read to its end.
        let _ = stream.write_all(body);
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        let text = String::from_utf8_lossy(&answer).into_owned();
        let status = text.split(' ').nth(1).and_then(|s| s.parse().ok()).unwrap_or(0);
        (status, text.split_once("\r\n\r\n").map_or(String::new(), |(_, body)| body.into()))
    }

    /// The next event of a stream of events.
    fn event(stream: &mut impl BufRead) -> Value {
        loop {
            let mut line = String::new();
            assert!(stream.read_line(&mut line).unwrap() > 0, "the stream has ended");
            if let Some(data) = line.strip_prefix("data: ") {
                return serde_json::from_str(data).unwrap();
            }
        }
    }

    fn own(&self, method: &str, path: &str, body: &[u8]) -> (u16, Value) {
        let (status, body) = self.ask(method, path, &[("x-token", &self.token)], body);
        (status, serde_json::from_str(&body).unwrap_or(Value::String(body)))
    }

    fn act(&self, request: Value) -> Value {
        let (status, state) = self.own("POST", "/api/do", request.to_string().as_bytes());
        assert_eq!(status, 200, "{request}: {state}");
        state
    }

    /// The state after the work that goes on.
    fn rested(&self) -> Value {
        let begun = Instant::now();
        loop {
            let (_, state) = self.own("GET", "/api/state", b"");
            if state["job"].is_null() {
                return state;
            }
            assert!(begun.elapsed() < Duration::from_secs(300), "{state}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    fn done(&self, request: Value) -> Value {
        self.act(request.clone());
        let state = self.rested();
        assert_eq!(state["message"], "", "{request}");
        state
    }
}

impl Drop for Studio {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn axis(folder: &Path) -> Vec<u8> {
    let csv = folder.join("axis.csv");
    let done = Command::new(env!("CARGO_BIN_EXE_deltatwin"))
        .args(["simulate", "scenarios/servo-axis.toml", "-o", &csv.display().to_string()])
        .output()
        .unwrap();
    assert!(done.status.success());
    std::fs::read(csv).unwrap()
}

#[test]
fn only_who_has_the_token_is_answered() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let studio = Studio::open(&folder.path().join("session"));
    let (token, path) = (studio.token.clone(), "/api/state");
    assert_eq!(studio.ask("GET", path, &[], b"").0, 403);
    assert_eq!(studio.ask("GET", path, &[("x-token", "0123")], b"").0, 403);
    assert_eq!(studio.ask("GET", path, &[("x-token", &token)], b"").0, 200);
    // A name that was made to point to this machine.
    assert_eq!(studio.ask("GET", path, &[("x-token", &token), ("Host", "evil.example")], b"").0, 403);
    let (status, page) = studio.ask("GET", &format!("/?token={token}"), &[], b"");
    assert!(status == 200 && page.contains("deltatwin studio") && !page.contains(&token));
    for escape in ["../Cargo.toml", "%2e%2e%2fsecret.toml", "/etc/passwd", "models/../../x.toml", "session.csv"] {
        let (status, _) = studio.ask("GET", &format!("/api/file?name={escape}"), &[("x-token", &token)], b"");
        assert_eq!(status, 404, "{escape}");
    }
    assert_eq!(studio.ask("GET", "/api/stage?name=../session", &[("x-token", &token)], b"").0, 404);
}

/// What is no request, or one that is too large, is told so; the server goes on.
#[test]
fn bad_requests_are_answered() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let studio = Studio::open(&folder.path().join("session"));
    let send = |text: &[u8]| {
        let mut stream = TcpStream::connect(&studio.host).unwrap();
        let _ = stream.write_all(text);
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).split(' ').nth(1).map(String::from)
    };
    assert_eq!(send(b"\0\xff nonsense\r\n\r\n").as_deref(), Some("400"));
    assert_eq!(send(b"POST /api/do HTTP/1.1\r\nContent-Length: many\r\n\r\n").as_deref(), Some("400"));
    assert_eq!(send(b"GET /api/state HTTP/1.1\r\n\r\n").as_deref(), Some("403"), "a request to no host");
    let long = ["GET /?token=", &"0".repeat(100_000), " HTTP/1.1\r\n\r\n"].concat();
    assert!(["414", "431"].map(Some).contains(&send(long.as_bytes()).as_deref()));
    let (status, answer) = studio.own("POST", "/api/do", &vec![b' '; 2 << 20]);
    assert_eq!((status, answer["error"].as_str()), (400, Some("the request is no text or too long")));
    // Half a megabyte of a gigabyte: the size that is announced is refused before it has come.
    let mut stream = TcpStream::connect(&studio.host).unwrap();
    let head = format!(
        "POST /api/file?name=run.csv HTTP/1.1\r\nHost: {}\r\nx-token: {}\r\nContent-Length: {}\r\n\r\n",
        studio.host,
        studio.token,
        1 << 30
    );
    stream.write_all(head.as_bytes()).unwrap();
    stream.write_all(&vec![b'1'; 1 << 19]).unwrap();
    let (mut answer, begun) = (String::new(), Instant::now());
    stream.read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 400") && answer.contains("run.csv: larger than 512 MB"), "{answer}");
    assert!(begun.elapsed() < Duration::from_secs(10), "{:?}", begun.elapsed());
    assert_eq!(studio.own("GET", "/api/state", b"").0, 200);
}

/// A window, an upload that hangs and a connection that says nothing do not keep the server from ending.
#[test]
#[cfg(unix)]
fn it_ends_when_it_is_interrupted() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let mut studio = Studio::open(&folder.path().join("session"));
    let say = |text: String| {
        let mut stream = TcpStream::connect(&studio.host).unwrap();
        stream.write_all(text.as_bytes()).unwrap();
        BufReader::new(stream)
    };
    let mut window = say(format!("GET /api/events?token={} HTTP/1.1\r\nHost: {}\r\n\r\n", studio.token, studio.host));
    Studio::event(&mut window);
    let upload = say(format!(
        "POST /api/file?name=run.csv HTTP/1.1\r\nHost: {}\r\nx-token: {}\r\nContent-Length: 1000\r\n\r\nt,q1",
        studio.host, studio.token
    ));
    let silent = say(String::new());
    let interrupted = Command::new("kill").args(["-INT", &studio.process.id().to_string()]).status().unwrap();
    assert!(interrupted.success());
    let begun = Instant::now();
    let status = loop {
        if let Some(status) = studio.process.try_wait().unwrap() {
            break status;
        }
        assert!(begun.elapsed() < Duration::from_secs(10), "it goes on");
        std::thread::sleep(Duration::from_millis(50));
    };
    assert!(status.success(), "{status}");
    let mut rest = String::new();
    window.read_to_string(&mut rest).unwrap();
    drop((upload, silent));
}

/// Two studios on one folder would overwrite each other's session; a killed one leaves the folder free.
#[test]
fn a_folder_is_open_once() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let first = Studio::open(folder.path());
    let second = || {
        Command::new(env!("CARGO_BIN_EXE_deltatwin"))
            .args(["studio", &folder.path().display().to_string(), "--json"])
            .output()
            .unwrap()
    };
    let refused = second();
    assert_eq!(refused.status.code(), Some(2));
    let answer: Value = serde_json::from_slice(&refused.stdout).unwrap();
    let message = answer["error"]["message"].as_str().unwrap();
    assert!(message.contains(&format!("already open at http://{};", first.host)), "{message}");
    assert!(!message.contains(&first.token));
    drop(first);
    assert_eq!(Studio::open(folder.path()).own("GET", "/api/state", b"").0, 200);
}

/// A request of another page changes nothing, though its address and token are right.
#[test]
fn a_page_of_another_server_changes_nothing() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let studio = Studio::open(&folder.path().join("session"));
    let (token, own) = (studio.token.as_str(), format!("http://{}", studio.host));
    let choose = json!({"do": "shipped", "model": "servo-axis.toml"}).to_string();
    let post = |path: &str, origin: &str, body: &[u8]| {
        studio.ask("POST", path, &[("x-token", token), ("Origin", origin)], body).0
    };
    for origin in
        ["http://evil.example", "null", "http://127.0.0.1:1", &own.replace("http", "https"), &format!("{own}0")]
    {
        assert_eq!(post("/api/do", origin, choose.as_bytes()), 403, "{origin}");
        assert_eq!(post("/api/file?name=a.csv", origin, b"t,q1,tau1\n0,1,2\n0.1,2,3\n"), 403, "{origin}");
    }
    assert!(studio.rested()["session"]["versions"].as_array().unwrap().is_empty());
    for origin in [own.clone(), own.replace("127.0.0.1", "localhost")] {
        assert_eq!(post("/api/do", &origin, choose.as_bytes()), 200, "{origin}");
    }
}

/// Pages of the folder run no scripts but their own, and what is in the folder is for its owner.
#[test]
fn files_are_served_with_a_policy_from_a_folder_of_the_owner() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let session = folder.path().join("deep/session");
    let studio = Studio::open(&session);
    studio.act(json!({"do": "shipped", "model": "servo-axis.toml"}));
    std::fs::write(session.join("page.html"), "<script>alert(1)</script>").unwrap();
    for name in ["page.html", "models/servo-axis.toml"] {
        let mut stream = TcpStream::connect(&studio.host).unwrap();
        let (host, token) = (&studio.host, &studio.token);
        write!(stream, "GET /api/file?name={name} HTTP/1.1\r\nHost: {host}\r\nx-token: {token}\r\n\r\n").unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        let policy = answer.lines().find(|line| line.starts_with("content-security-policy: ")).unwrap();
        assert!(policy.contains("default-src 'none'") && policy.contains("script-src 'sha256-"), "{policy}");
        assert!(!policy.contains("script-src 'unsafe-inline'") && answer.contains("x-content-type-options: nosniff"));
    }
    #[cfg(unix)]
    for part in ["deep", "deep/session", "deep/session/models"] {
        use std::os::unix::fs::PermissionsExt;
        let mode = std::fs::metadata(folder.path().join(part)).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o700, "{part}");
    }
}

/// Connections that say nothing, or not all, keep nobody from an answer; those that wait for one keep theirs.
#[test]
fn silent_connections_keep_no_places() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let studio = Studio::open(&folder.path().join("session"));
    let connect = |text: &str| {
        let mut stream = TcpStream::connect(&studio.host).unwrap();
        stream.write_all(text.as_bytes()).unwrap();
        stream
    };
    let head = format!("GET /api/events?token={} HTTP/1.1\r\nHost: {}\r\n\r\n", studio.token, studio.host);
    let mut window = BufReader::new(connect(&head));
    Studio::event(&mut window);
    let silent: Vec<TcpStream> = (0..300).map(|k| connect(["", "GET /api/sta"][k % 2])).collect();
    let begun = Instant::now();
    assert_eq!(studio.own("GET", "/api/state", b"").0, 200);
    assert!(begun.elapsed() < Duration::from_secs(2), "{:?}", begun.elapsed());
    studio.act(json!({"do": "shipped", "model": "servo-axis.toml"}));
    assert_eq!(Studio::event(&mut window)["session"]["versions"][0]["file"], "models/servo-axis.toml");
    drop(silent);
}

#[test]
fn bad_files_change_nothing_but_a_message() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let studio = Studio::open(&folder.path().join("session"));
    let before = studio.rested()["session"].clone();
    let bad: [(&str, &[u8]); 4] = [
        ("..%2F..%2Fescape.csv", &[0, 1, 2, 255, 0]),
        ("%3Cscript%3E.csv", b""),
        ("model.toml", b"[geometry]\nx = 1\n"),
        ("run.mcap", b"\x89MCAP0\r\nnothing"),
    ];
    for (name, content) in bad {
        let (status, answer) = studio.own("POST", &format!("/api/file?name={name}"), content);
        assert!(status == 400 && answer["error"].as_str().is_some_and(|e| !e.is_empty()), "{name}: {answer}");
    }
    for request in
        [json!({"do": "fly"}), json!({"do": "fit"}), json!({"do": "undo"}), json!({"do": "version", "version": 9})]
    {
        assert_eq!(studio.own("POST", "/api/do", request.to_string().as_bytes()).0, 400, "{request}");
    }
    assert_eq!(studio.own("POST", "/api/do", b"no json").0, 400);
    let how = json!({"do": "read", "how": {"maps": ["q1=["]}});
    assert_eq!(studio.own("POST", "/api/do", how.to_string().as_bytes()).0, 400);
    assert_eq!(studio.rested()["session"], before);
    assert!(!folder.path().join("escape.csv").exists());
}

#[test]
fn the_loop_goes_on_after_a_kill() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let session = folder.path().join("session");
    let csv = axis(folder.path());
    let studio = Studio::open(&session);
    assert_eq!(studio.own("POST", "/api/file?name=axis.csv", &csv).0, 200);
    studio.act(json!({"do": "shipped", "model": "servo-axis.toml"}));
    // A turned torque is told, and its remedy heals it.
    studio.act(json!({"do": "read", "how": {"maps": ["tau1=-tau1"]}}));
    let state = studio.done(json!({"do": "check"}));
    let check = &state["session"]["stages"]["check"];
    assert_eq!(check["good"], false, "{check}");
    // The table shows the turned axis, and what was not looked at for its sake.
    let table = || studio.ask("GET", "/api/stage?name=check", &[("x-token", &studio.token)], b"").1;
    let shown = table();
    assert!(shown.contains("✗</i> torque sign") && shown.contains("–</i> not checked"), "{shown}");
    let remedy = check["remedies"].as_array().unwrap().iter().find(|r| r["kind"] == "map").unwrap()["text"].clone();
    assert_eq!(studio.own("POST", "/api/do", json!({"do": "fit"}).to_string().as_bytes()).0, 400);
    studio.act(json!({"do": "read", "how": {"maps": ["tau1=-tau1", remedy]}}));
    let state = studio.done(json!({"do": "check"}));
    assert_eq!(state["session"]["stages"]["check"]["good"], true, "{state}");
    assert!(table().contains("✓</i> ok") && !table().contains("✗</i>"));
    // The command of *Where* names the model that the page shows.
    let shows_its_model = |state: &Value| {
        let shown = &state["session"]["stages"]["where"];
        let version = shown["version"].as_u64().unwrap() as usize;
        let file = state["session"]["versions"][version]["file"].as_str().unwrap();
        let command = shown["command"].as_str().unwrap();
        assert!(version > 0 && command.starts_with(&format!("deltatwin compare {file} ")), "{command}: {file}");
    };
    studio.done(json!({"do": "fit"}));
    shows_its_model(&studio.done(json!({"do": "where"})));
    // The error of a new version is known before its residuals are.
    let added = studio.done(json!({"do": "add", "effect": "drive_stribeck"}));
    assert!(
        added["session"]["versions"][2]["errors"].is_object() && added["session"]["stages"]["where"]["version"] == 1
    );
    let state = studio.done(json!({"do": "where"}));
    shows_its_model(&state);
    let rms = |state: &Value, k: usize| state["session"]["versions"][k]["errors"]["rms"][0].as_f64().unwrap();
    assert!(rms(&state, 1) <= rms(&state, 0) && rms(&state, 2) <= 1.001 * rms(&state, 1), "{state}");
    assert_eq!(state["chain"], json!([0, 1, 2]));
    let kept = state["session"].clone();
    drop(studio);

    let studio = Studio::open(&session);
    assert_eq!(studio.rested()["session"], kept);
    let (status, part) = studio.ask("GET", "/api/stage?name=where", &[("x-token", &studio.token)], b"");
    assert!(status == 200 && part.contains("data-signals"));
    let saved = || {
        studio.act(json!({"do": "save"}));
        std::fs::read_to_string(session.join("report.html")).unwrap()
    };
    let page = saved();
    assert!(page.contains("Content-Security-Policy") && page.contains("data-signals"));
    // The residuals are of the version that was undone.
    assert_eq!(studio.act(json!({"do": "undo"}))["session"]["current"], 1);
    assert!(!saved().contains("data-signals"));
    // The command line goes on with the files of the session.
    let command = kept["versions"][1]["command"].as_str().unwrap().replace("'", "");
    let words: Vec<&str> = command.split(' ').skip(1).filter(|w| *w != "--map" && !w.starts_with("tau1=")).collect();
    assert_eq!(words[..2], ["identify", "models/servo-axis.toml"], "{command}");
}

/// Results belong to their inputs: what comes back brings them back, and what a change does not touch stays.
#[test]
fn results_come_back_with_their_inputs() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let session = folder.path().join("session");
    let csv = axis(folder.path());
    let shorter = csv[..csv[..csv.len() / 2].iter().rposition(|byte| *byte == b'\n').unwrap() + 1].to_vec();
    let studio = Studio::open(&session);
    let drop_file = |name: &str, content: &[u8]| {
        let (status, state) = studio.own("POST", &format!("/api/file?name={name}"), content);
        assert_eq!(status, 200, "{state}");
        state["session"].clone()
    };
    let part = |name: &str| studio.ask("GET", &format!("/api/stage?name={name}"), &[("x-token", &studio.token)], b"").1;
    let stages = |session: &Value| session["stages"].as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    drop_file("axis.csv", &csv);
    studio.act(json!({"do": "shipped", "model": "servo-axis.toml"}));
    studio.done(json!({"do": "check"}));
    studio.done(json!({"do": "fit"}));
    studio.done(json!({"do": "add", "effect": "drive_stribeck"}));
    let before = studio.done(json!({"do": "where"}))["session"].clone();
    let parts = ["check", "fit", "where", "add"].map(part);
    assert_eq!(stages(&before), ["add", "check", "fit", "where"]);
    let same = |now: &Value| {
        for key in ["stages", "versions", "current", "basis"] {
            assert_eq!(now[key], before[key], "{key}");
        }
        assert_eq!(["check", "fit", "where", "add"].map(part), parts);
    };
    // A recording that judges: the fit does not depend on it, all else does.
    let more = drop_file("more.csv", &shorter);
    assert_eq!((stages(&more), &more["recordings"][1]["held_out"]), (vec!["fit".to_string()], &json!(true)));
    assert!(more["versions"][1]["errors"].is_null() && more["stages"]["fit"] == before["stages"]["fit"]);
    studio.done(json!({"do": "check"}));
    same(&studio.act(json!({"do": "leave_out", "recording": 1}))["session"]);
    // The recording itself, taken out and dropped again; and once more, which changes nothing.
    assert!(stages(&studio.act(json!({"do": "leave_out", "recording": 0}))["session"]).is_empty());
    same(&drop_file("axis.csv", &csv));
    same(&drop_file("axis.csv", &csv));
    // Another reading, and the one of before.
    assert!(stages(&studio.act(json!({"do": "read", "how": {"maps": ["tau1=-tau1"]}}))["session"]).is_empty());
    same(&studio.act(json!({"do": "read", "how": {}}))["session"]);
    // Another first model, and the one of before: its versions are there, the first is in use.
    studio.act(json!({"do": "shipped", "model": "linear-delta.toml"}));
    studio.act(json!({"do": "shipped", "model": "servo-axis.toml"}));
    same(&studio.act(json!({"do": "version", "version": 2}))["session"]);
    // A setup of a recording changes its results.
    assert!(stages(&drop_file("axis.setup.toml", b"configuration = \"assembled\"\n")).is_empty());
}

/// A stage that is cancelled makes room for the next one at once, and leaves nothing.
#[test]
fn a_cancelled_stage_ends_at_once() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let session = folder.path().join("session");
    let csv = axis(folder.path());
    let studio = Studio::open(&session);
    assert_eq!(studio.own("POST", "/api/file?name=axis.csv", &csv).0, 200);
    studio.act(json!({"do": "shipped", "model": "servo-axis.toml"}));
    studio.done(json!({"do": "check"}));
    for pause in [0, 20, 100] {
        studio.act(json!({"do": "why"}));
        std::thread::sleep(Duration::from_millis(pause));
        let begun = Instant::now();
        let state = studio.act(json!({"do": "cancel"}));
        assert!(state["job"].is_null() && begun.elapsed() < Duration::from_millis(500), "{:?}", begun.elapsed());
        if state["message"] == "" {
            assert!(pause > 0, "the stage had not ended");
            continue;
        }
        assert_eq!(state["message"], "`why` is cancelled; nothing has changed");
        assert!(studio.done(json!({"do": "where"}))["session"]["stages"]["why"].is_null());
    }
}

/// A law without a value at some sample is refused with the term, the value and the sample.
#[test]
fn a_law_without_a_value_is_blamed() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let session = folder.path().join("session");
    let csv = axis(folder.path());
    let studio = Studio::open(&session);
    assert_eq!(studio.own("POST", "/api/file?name=axis.csv", &csv).0, 200);
    studio.act(json!({"do": "shipped", "model": "servo-axis"}));
    studio.done(json!({"do": "check"}));
    studio.act(json!({"do": "add", "effect": "formula", "laws": ["drive1: -qd1", "drive1: sqrt(-1 - q1^2)"]}));
    let state = studio.rested();
    let message = state["message"].as_str().unwrap();
    assert_eq!(state["term"], 1);
    assert!(message.starts_with("term 2, `drive1: sqrt(-1 - q1^2)`: the law gives NaN at t = "), "{message}");
    assert!(message.contains(" of axis, ") && !message.contains("radians"), "{message}");
    let state = studio.done(json!({"do": "add", "effect": "formula", "laws": ["drive1: -qd1"]}));
    assert!(state["term"].is_null() && state["session"]["current"] == 1);
}

/// An empty session is filled with the recordings of `deltatwin example`, and their model.
#[test]
#[ignore = "campaign"]
fn an_example_fills_an_empty_session() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let session = folder.path().join("session");
    let studio = Studio::open(&session);
    let state = studio.done(json!({"do": "example"}));
    let recordings = state["session"]["recordings"].as_array().unwrap();
    assert_eq!((&recordings[0]["held_out"], &recordings[1]["held_out"]), (&json!(false), &json!(true)));
    assert_eq!(studio.own("POST", "/api/do", json!({"do": "example"}).to_string().as_bytes()).0, 400);
    assert_eq!(studio.done(json!({"do": "check"}))["session"]["stages"]["check"]["good"], true);
    let written = folder.path().join("example");
    let done = Command::new(env!("CARGO_BIN_EXE_deltatwin")).args(["example", "-o"]).arg(&written).output().unwrap();
    assert!(done.status.success());
    for (own, file) in
        [("data/first.csv", "first.csv"), ("data/second.csv", "second.csv"), ("hidden.txt", "hidden.txt")]
    {
        assert!(std::fs::read(session.join(own)).unwrap() == std::fs::read(written.join(file)).unwrap(), "{file}");
    }
}

#[test]
fn windows_are_told_what_changes_and_what_is_wrong_with_a_typed_law() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let studio = Studio::open(folder.path());
    let listen = |token: &str| {
        let mut stream = TcpStream::connect(&studio.host).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        write!(stream, "GET /api/events?token={token} HTTP/1.1\r\nHost: {}\r\n\r\n", studio.host).unwrap();
        BufReader::new(stream)
    };
    let mut head = String::new();
    listen("wrong").read_line(&mut head).unwrap();
    assert!(head.contains("403"), "{head}");
    // All at once, as a browser opens the windows of its last session.
    let mut windows: Vec<_> = (0..12).map(|_| listen(&studio.token)).collect();
    for window in &mut windows {
        assert!(Studio::event(window)["session"]["versions"].as_array().unwrap().is_empty());
    }
    studio.act(json!({"do": "shipped", "model": "servo-axis.toml"}));
    for window in &mut windows {
        assert_eq!(Studio::event(window)["session"]["versions"][0]["file"], "models/servo-axis.toml");
    }
    let asked = |at: &str, law: &str| studio.own("GET", &format!("/api/formula?at={at}&law={law}"), b"").1;
    assert_eq!(asked("drive1", "-qd1*abs(qd1)")["unit"], "N·s²/m²");
    let wrong = asked("drive1", "-tanh(50*qd9)");
    assert_eq!((wrong["from"].as_u64(), wrong["to"].as_u64()), (Some(9), Some(12)), "{wrong}");
    assert!(asked("platform_x", "1")["problem"].as_str().unwrap().contains("drive1"));
    let begun = Instant::now();
    assert!(asked("drive1", &"q".repeat(50_000))["problem"].as_str().unwrap().contains("longer than 4096 bytes"));
    assert!(begun.elapsed() < Duration::from_secs(1), "{:?}", begun.elapsed());
}

/// Twelve windows listen, four uploads come at once and slowly, and a question in between is answered at once.
#[test]
fn uploads_and_windows_do_not_wait_for_each_other() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let csv = axis(folder.path());
    let studio = Studio::open(&folder.path().join("session"));
    let windows: Vec<TcpStream> = (0..12)
        .map(|_| {
            let mut stream = TcpStream::connect(&studio.host).unwrap();
            write!(stream, "GET /api/events?token={} HTTP/1.1\r\nHost: {}\r\n\r\n", studio.token, studio.host).unwrap();
            stream
        })
        .collect();
    std::thread::scope(|scope| {
        let slow = |k: usize| {
            let (csv, studio) = (&csv, &studio);
            move || {
                let mut stream = TcpStream::connect(&studio.host).unwrap();
                write!(
                    stream,
                    "POST /api/file?name=run{k}.csv HTTP/1.1\r\nHost: {}\r\nx-token: {}\r\nContent-Length: {}\r\n\r\n",
                    studio.host,
                    studio.token,
                    csv.len() + k
                )
                .unwrap();
                let (first, rest) = csv.split_at(csv.len() / 2);
                stream.write_all(first).unwrap();
                std::thread::sleep(Duration::from_secs(2));
                stream.write_all(rest).unwrap();
                // Files that differ.
                stream.write_all(&b"\n".repeat(k)).unwrap();
                let mut answer = String::new();
                stream.read_to_string(&mut answer).unwrap();
                assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
            }
        };
        let uploads: Vec<_> = (0..4).map(|k| scope.spawn(slow(k))).collect();
        std::thread::sleep(Duration::from_millis(300));
        let begun = Instant::now();
        assert_eq!(studio.own("GET", "/api/state", b"").0, 200);
        assert!(begun.elapsed() < Duration::from_millis(1500), "{:?}", begun.elapsed());
        uploads.into_iter().for_each(|upload| upload.join().unwrap());
    });
    assert_eq!(studio.rested()["session"]["recordings"].as_array().unwrap().len(), 4);
    drop(windows);
}

#[test]
fn the_folder_of_a_bag_is_one_recording() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let bag = folder.path().join("part_0.mcap");
    let done = Command::new(env!("CARGO_BIN_EXE_deltatwin"))
        .args(["simulate", "scenarios/servo-axis.toml", "-o", &bag.display().to_string()])
        .output()
        .unwrap();
    assert!(done.status.success());
    let content = std::fs::read(bag).unwrap();
    let metadata = b"rosbag2_bagfile_information:\n  relative_file_paths:\n    - part_0.mcap\n";
    let studio = Studio::open(&folder.path().join("session"));
    let send = |name: &str, parts: &[(&str, &[u8])]| {
        let sizes: Vec<Value> = parts.iter().map(|(name, content)| json!([name, content.len()])).collect();
        let sizes = json!(sizes).to_string().replace('"', "%22").replace(' ', "");
        let body: Vec<u8> = parts.iter().flat_map(|(_, content)| content.to_vec()).collect();
        studio.own("POST", &format!("/api/bag?name={name}&parts={sizes}"), &body)
    };
    let parts: [(&str, &[u8]); 2] = [("metadata.yaml", metadata), ("part_0.mcap", &content)];
    // Twice the same is one recording.
    for _ in 0..2 {
        let (status, state) = send("..%2Fmorning", &parts);
        assert_eq!((status, &state["session"]["recordings"][0]["file"]), (200, &json!("data/morning")), "{state}");
        assert_eq!(state["session"]["recordings"].as_array().unwrap().len(), 1);
    }
    studio.act(json!({"do": "shipped", "model": "servo-axis.toml"}));
    assert_eq!(studio.done(json!({"do": "check"}))["session"]["stages"]["check"]["good"], true);
    let (_, columns) = studio.own("GET", "/api/columns?recording=0", b"");
    assert!(columns["rows"].as_u64().is_some_and(|rows| rows > 1000), "{columns}");

    // What is none, or names files elsewhere, changes nothing.
    let elsewhere = b"rosbag2_bagfile_information:\n  relative_file_paths:\n    - ../morning/part_0.mcap\n";
    let bad: [&[(&str, &[u8])]; 4] = [
        &[("part_0.mcap", &content)],
        &[("metadata.yaml", metadata), ("../part_0.mcap", &content)],
        &[("metadata.yaml", elsewhere)],
        &[("metadata.yaml", metadata), ("metadata.yaml", metadata)],
    ];
    for parts in bad {
        let (status, answer) = send("evening", parts);
        assert!(status == 400 && answer["error"].is_string(), "{answer}");
    }
    assert_eq!(studio.rested()["session"]["recordings"].as_array().unwrap().len(), 1);
    assert_eq!(std::fs::read_dir(folder.path().join("session/data")).unwrap().count(), 1);
}

/// The viewer's program comes from the server itself, and its page may load nothing from elsewhere.
#[test]
#[cfg(feature = "viewer")]
fn a_recording_is_shown_in_the_viewer_beside() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let csv = axis(folder.path());
    let studio = Studio::open(&folder.path().join("session"));
    assert_eq!(studio.own("GET", "/api/rrd", b"").0, 404);
    assert_eq!(studio.own("POST", "/api/file?name=axis.csv", &csv).0, 200);
    studio.act(json!({"do": "shipped", "model": "servo-axis.toml"}));
    studio.done(json!({"do": "check"}));
    studio.done(json!({"do": "fit"}));
    let state = studio.done(json!({"do": "view"}));
    assert_eq!((state["shown"]["serial"].as_u64(), state["shown"]["version"].as_u64()), (Some(1), Some(1)));
    assert!(state["shown"]["commands"][1].as_str().unwrap().contains("replay data/axis.csv --model"), "{state}");
    let token = [("x-token", studio.token.as_str())];
    let (status, file) = studio.ask("GET", "/api/rrd", &token, b"");
    assert!(status == 200 && file.starts_with("RRF2"), "{status}");
    assert_eq!(studio.ask("GET", "/viewer", &[], b"").0, 403);
    let (status, page) = studio.ask("GET", "/viewer", &token, b"");
    assert!(status == 200 && page.contains("/re_viewer.js"));
    let (status, program) = studio.ask("GET", "/re_viewer_bg.wasm", &[], b"");
    assert!(status == 200 && program.len() > 1_000_000 && program.starts_with("\0asm"), "{status}");
}
