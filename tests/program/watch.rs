//! Watching a machine that runs, by a real broker and from a growing file.

use crate::common;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::TempDir;

const MODEL: &str = "models/irb360-6-1600-truth.toml";
const SAMPLES: u64 = 50_000;

fn program() -> Command {
    Command::new(assert_cmd::cargo::cargo_bin("deltatwin"))
}

/// A child process that does not outlive its test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

/// A broker with sessions that survive it.
struct Broker {
    folder: PathBuf,
    port: u16,
}

impl Broker {
    /// `None` where no broker is installed.
    fn new(folder: &Path) -> Option<Self> {
        let installed = Command::new(Self::program()).arg("-h").stdout(Stdio::null()).stderr(Stdio::null()).status();
        if installed.is_err() {
            eprintln!("not tested: mosquitto is not installed");
            return None;
        }
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let folder = folder.join("broker");
        std::fs::create_dir(&folder).unwrap();
        // It may run as another user than the tests.
        let mut open = std::fs::metadata(&folder).unwrap().permissions();
        std::os::unix::fs::PermissionsExt::set_mode(&mut open, 0o777);
        std::fs::set_permissions(&folder, open).unwrap();
        let config = format!(
            "listener {port} 127.0.0.1\nallow_anonymous true\npersistence true\npersistence_location {}/\n\
             max_queued_messages 0\nuser root\n",
            folder.display()
        );
        std::fs::write(folder.join("broker.conf"), config).unwrap();
        Some(Self { folder, port })
    }

    fn program() -> &'static str {
        if Path::new("/usr/sbin/mosquitto").exists() { "/usr/sbin/mosquitto" } else { "mosquitto" }
    }

    fn start(&self) -> Running {
        let mut command = Command::new(Self::program());
        command.arg("-c").arg(self.folder.join("broker.conf")).stdout(Stdio::null()).stderr(Stdio::null());
        let broker = Running(command.spawn().unwrap());
        let start = Instant::now();
        while std::net::TcpStream::connect(("127.0.0.1", self.port)).is_err() {
            assert!(start.elapsed() < Duration::from_secs(10), "the broker does not start");
            std::thread::sleep(Duration::from_millis(20));
        }
        broker
    }

    fn url(&self) -> String {
        format!("mqtt://127.0.0.1:{}", self.port)
    }

    /// The retained message of a topic.
    fn retained(&self, topic: &str) -> Value {
        let out = Command::new("mosquitto_sub")
            .args(["-p", &self.port.to_string(), "-t", topic, "-C", "1", "-W", "10"])
            .output()
            .unwrap();
        serde_json::from_slice(&out.stdout).unwrap_or_else(|e| panic!("{topic}: {e}"))
    }
}

/// Ends a broker at once, as kill -9 does.
fn kill(mut broker: Running) {
    broker.0.kill().unwrap();
    broker.0.wait().unwrap();
}

fn path(folder: &TempDir, name: &str) -> String {
    folder.path().join(name).display().to_string()
}

/// Recordings of the machine: healthy, and with twice the friction in the ball sockets.
fn recordings(folder: &TempDir) -> [String; 2] {
    let truth = std::fs::read_to_string(MODEL).unwrap();
    let worn = truth.replace("moment = 0.285 ", "moment = 0.57 ");
    assert_ne!(truth, worn);
    std::fs::write(folder.path().join("worn.toml"), worn).unwrap();
    let [healthy, worn] = [path(folder, "healthy.mcap"), path(folder, "worn.mcap")];
    let worn_model = path(folder, "worn.toml");
    for (output, model, scenario) in
        [(&healthy, MODEL, "scenarios/excitation.toml"), (&worn, worn_model.as_str(), "scenarios/excitation.toml")]
    {
        let status =
            program().args(["simulate", scenario, "--model", model, "-o", output]).stdout(Stdio::null()).status();
        assert!(status.unwrap().success());
    }
    [healthy, worn]
}

fn verdict(out: &std::process::Output) -> Value {
    serde_json::from_slice(&out.stdout).unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(&out.stderr)))
}

/// What must be the same, whichever way the samples came.
fn essence(verdict: &Value) -> [&Value; 4] {
    ["state", "alarm", "cause", "highest_level"].map(|key| &verdict[key])
}

/// The broker is killed twice on the way; every sample arrives once, and the verdict is that of the same samples from a
/// file.
#[test]
fn wear_is_named_through_a_broker_that_is_killed() {
    common::at_root();
    let folder = tempfile::tempdir().unwrap();
    let Some(broker) = Broker::new(folder.path()) else { return };
    let [healthy, worn] = recordings(&folder);
    let mut running = broker.start();
    let tape = path(&folder, "tape.mcap");
    let url = broker.url();
    let options = ["--learn", "19", "--last", "20", "--false-alarms", "0.1"];
    let mut watch = program();
    watch.args(["watch", MODEL, "--mqtt", &url, "--topic", "robot/joints", "-o", &tape, "--json", "--patience", "15"]);
    let watch = watch.args(options).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // The subscription must stand before the first sample is sent.
    std::thread::sleep(Duration::from_secs(2));
    let mut replay = program();
    replay.args(["replay", &healthy, &worn, "--mqtt", &url, "--topic", "robot/joints", "--speed", "4", "--json"]);
    let mut replay = Running(replay.stdout(Stdio::piped()).spawn().unwrap());
    for _ in 0..2 {
        std::thread::sleep(Duration::from_secs(3));
        kill(running);
        std::thread::sleep(Duration::from_millis(700));
        running = broker.start();
    }
    assert!(replay.0.wait().unwrap().success());
    let out = watch.wait_with_output().unwrap();
    assert_eq!(out.status.code(), Some(1), "{}", String::from_utf8_lossy(&out.stderr));
    let live = verdict(&out);
    let samples = &live["samples"];
    assert_eq!((samples["taken"].as_u64(), samples["missing"].as_u64()), (Some(2 * SAMPLES), Some(2499)), "{samples}");
    assert_eq!(live["state"], "changed");
    let effects: Vec<&Value> = live["cause"]["effects"].as_array().unwrap().iter().map(|e| &e["name"]).collect();
    assert_eq!(effects, ["ball_socket_coulomb"], "{live:#}");
    let moment = &live["cause"]["effects"][0]["parameters"]["moment"];
    let ratio = moment["after"].as_f64().unwrap() / moment["before"].as_f64().unwrap();
    assert!((ratio - 2.0).abs() < 0.1, "{moment}");
    // What is retained is what was said.
    assert_eq!(broker.retained("deltatwin/verdict"), live);
    assert_eq!(broker.retained("deltatwin/residual")["channels"].as_array().unwrap().len(), 4);
    assert_eq!(broker.retained("deltatwin/margins")["margin"].as_array().unwrap().len(), 12);

    let mut offline = program();
    offline.args(["watch", MODEL, "--follow", &tape, "--json"]).args(options);
    let offline = verdict(&offline.output().unwrap());
    assert_eq!(essence(&offline), essence(&live));
}

/// A watch that is killed leaves a recording of all but the last second.
#[test]
fn a_killed_watch_leaves_its_recording() {
    common::at_root();
    let folder = tempfile::tempdir().unwrap();
    let source = path(&folder, "source.csv");
    let mut out = std::fs::File::create(&source).unwrap();
    writeln!(out, "t,q1,q2,q3,q4,tau1,tau2,tau3,tau4").unwrap();
    let tape = path(&folder, "tape.mcap");
    let mut watch = program();
    watch.args(["watch", MODEL, "--follow", &source, "-o", &tape]).stdout(Stdio::null()).stderr(Stdio::null());
    let watch = Running(watch.spawn().unwrap());
    // Half a second of samples every half second, as from a machine.
    let start = Instant::now();
    let mut k = 0;
    while start.elapsed() < Duration::from_secs(5) {
        while f64::from(k) * 0.002 < start.elapsed().as_secs_f64() {
            let t = f64::from(k) * 0.002;
            let wave = |phase: f64| 0.3 + 0.1 * (3.0 * t + phase).sin();
            let row: Vec<String> = (0..8).map(|c| wave(f64::from(c)).to_string()).collect();
            writeln!(out, "{t},{}", row.join(",")).unwrap();
            k += 1;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    drop(watch);
    let partial = path(&folder, "tape.partial.mcap");
    let out = program().args(["check", &partial, "--json"]).output().unwrap();
    let text = String::from_utf8_lossy(&out.stdout).into_owned();
    let csv = path(&folder, "tape.csv");
    let exported = program().args(["export", &partial, "--csv", &csv]).output().unwrap();
    assert!(exported.status.success(), "{text} {}", String::from_utf8_lossy(&exported.stderr));
    let rows = std::fs::read_to_string(&csv).unwrap().lines().count() - 1;
    assert!(rows as f64 * 0.002 > 4.0, "{rows} of {k} samples");
}

/// Whatever else is sent to the topic, the watch goes on.
#[test]
fn hostile_messages_cost_a_warning() {
    common::at_root();
    let folder = tempfile::tempdir().unwrap();
    let Some(broker) = Broker::new(folder.path()) else { return };
    let _running = broker.start();
    let mut watch = program();
    watch.args(["watch", MODEL, "--mqtt", &broker.url(), "--topic", "robot/joints", "--json", "--idle", "4"]);
    let watch = watch.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    std::thread::sleep(Duration::from_secs(2));
    let huge = format!("{{\"t\": 1, \"q\": [{}]}}", "1,".repeat(2_000_000));
    let deep = "[".repeat(1_000_000);
    let messages = [
        "",
        "x",
        "{}",
        "null",
        "[[[]]]",
        r#"{"t": 1e999, "q": [1,2,3,4], "tau": [1,2,3,4]}"#,
        &huge,
        &deep,
        r#"{"t": -4e9, "q": [1e5,1e5,1e5,1e5], "tau": [1e9,0,0,0]}"#,
        r#"{"t": 4e9, "q": [0,0,0,0], "tau": [0,0,0,0]}"#,
        r#"{"t": 0.0004, "q": ["1",0,0,0], "tau": [0,0,0,0]}"#,
        "\u{0}\u{1}\u{fffd}",
    ];
    for message in messages {
        let mut sender = Command::new("mosquitto_pub");
        sender.args(["-p", &broker.port.to_string(), "-t", "robot/joints", "-q", "1", "-s"]).stdin(Stdio::piped());
        let mut sender = sender.spawn().unwrap();
        sender.stdin.take().unwrap().write_all(message.as_bytes()).unwrap();
        assert!(sender.wait().unwrap().success());
    }
    let out = watch.wait_with_output().unwrap();
    assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
    let verdict = verdict(&out);
    assert_eq!(
        (&verdict["state"], verdict["samples"]["unusable_messages"].as_u64()),
        (&Value::from("learning"), Some(10))
    );
}

#[test]
fn wrong_invocations_are_refused() {
    common::at_root();
    let refused = |arguments: &[&str]| {
        let out = program().arg("watch").arg(MODEL).args(arguments).output().unwrap();
        assert_eq!(out.status.code(), Some(2), "{arguments:?}");
        String::from_utf8_lossy(&out.stderr).into_owned()
    };
    assert!(refused(&[]).contains("--follow"));
    assert!(refused(&["--mqtt", "127.0.0.1", "--topic", "a"]).contains("expected mqtt://HOST"));
    assert!(refused(&["--mqtt", "mqtt://127.0.0.1:9", "--topic", "a"]).contains("no broker answers"));
    assert!(refused(&["--follow", "none.csv"]).contains("none.csv"));
    assert!(refused(&["--follow", "Cargo.toml"]).contains("has no column `t`"));
    assert!(refused(&["--follow", "a.csv", "--healthy", "Cargo.toml"]).contains("Cargo.toml"));
}
