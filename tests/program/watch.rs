//! Watching a machine that runs, by a real broker and from a growing file.

use crate::common;

use std::io::{BufRead, BufReader, Write};
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
    /// One that everybody may use; `None` where no broker is installed.
    fn new(folder: &Path) -> Option<Self> {
        Self::with(folder, "allow_anonymous true")
    }

    /// One with these lines about who may use it.
    fn with(folder: &Path, access: &str) -> Option<Self> {
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
            "listener {port} 127.0.0.1\n{access}\npersistence true\npersistence_location {}/\n\
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

/// The healthy machine and then the worn one, as a file to follow.
fn in_turn(folder: &TempDir) -> String {
    let file = path(folder, "both.csv");
    let mut out = std::fs::File::create(&file).unwrap();
    writeln!(out, "t,q1,q2,q3,q4,tau1,tau2,tau3,tau4").unwrap();
    for (recording, begin) in recordings(folder).iter().zip([0.0, 20.0]) {
        let signals = deltatwin_io::recording::read(Path::new(recording), None).unwrap().0.signals;
        for (k, t) in signals.t.iter().enumerate() {
            let values = [signals.q().at(k), signals.tau().at(k)].concat();
            let values: Vec<String> = values.iter().map(ToString::to_string).collect();
            writeln!(out, "{},{}", begin + t, values.join(",")).unwrap();
        }
    }
    file
}

/// The end of the samples gives the verdict at once; the cause follows, and Ctrl-C does not wait for it.
#[test]
fn the_verdict_does_not_wait_for_the_cause() {
    common::at_root();
    let folder = tempfile::tempdir().unwrap();
    let file = in_turn(&folder);
    for is_interrupted in [false, true] {
        let mut watch = program();
        watch.args(["watch", MODEL, "--follow", &file, "--idle", "0.5", "--learn", "19", "--last", "20"]);
        let mut watch = watch.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(watch.stdout.take().unwrap()).lines().map(Result::unwrap);
        assert!(lines.any(|line| line.contains("ALARM")));
        let alarm = Instant::now();
        assert!(lines.any(|line| line.starts_with("changed after")));
        assert!(alarm.elapsed() < Duration::from_secs(5), "{:?}", alarm.elapsed());
        let verdict = Instant::now();
        if is_interrupted {
            assert!(Command::new("kill").args(["-INT", &watch.id().to_string()]).status().unwrap().success());
        }
        let rest: Vec<String> = lines.collect();
        let out = watch.wait_with_output().unwrap();
        assert_eq!(
            rest.iter().any(|line| line.contains("ball_socket_coulomb has changed")),
            !is_interrupted,
            "{rest:?}"
        );
        assert_eq!(out.status.code(), Some(if is_interrupted { 130 } else { 1 }));
        let awaited = String::from_utf8_lossy(&out.stderr).into_owned();
        match is_interrupted {
            true => assert!(verdict.elapsed() < Duration::from_secs(2), "{:?}", verdict.elapsed()),
            false => assert!(awaited.contains("determining the cause from 20 s of samples; Ctrl-C"), "{awaited}"),
        }
    }
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

/// Row `k` of a recording at 500 Hz that counts from `start` (s since 1970): time, angles and torques.
fn row(start: u64, k: u64) -> [String; 3] {
    let wave = |c: u64| (0.3 + 0.1 * (0.006 * k as f64 + c as f64).sin()).to_string();
    let [q, tau] = [0, 4].map(|first| (first..first + 4).map(wave).collect::<Vec<_>>().join(","));
    [format!("{}.{:03}", start + k / 500, 2 * (k % 500)), q, tau]
}

/// Seconds since 1970 as a machine states them.
const NOW: u64 = 1_795_510_000;

#[test]
fn a_machine_on_a_unix_clock_is_recorded_to_the_nanosecond() {
    common::at_root();
    let folder = tempfile::tempdir().unwrap();
    let source = path(&folder, "source.csv");
    let rows: Vec<String> = (0..2_000).map(|k| row(NOW, k).join(",")).collect();
    std::fs::write(&source, format!("t,q1,q2,q3,q4,tau1,tau2,tau3,tau4\n{}\n", rows.join("\n"))).unwrap();
    let watched = |file: &str, arguments: &[&str]| {
        let mut watch = program();
        watch.args(["watch", MODEL, "--follow", file, "--json", "--idle", "0.5"]).args(arguments);
        let out = watch.output().unwrap();
        assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
        verdict(&out)
    };
    for name in ["tape.mcap", "tape.csv"] {
        let tape = path(&folder, name);
        let live = watched(&source, &["-o", &tape]);
        assert_eq!(live["samples"]["taken"], 2_000);
        assert!((live["t"].as_f64().unwrap() - NOW as f64 - 3.1).abs() < 0.1, "{live}");
        let (recording, warnings) = deltatwin_io::recording::read(Path::new(&tape), None).unwrap();
        let t = &recording.signals.t;
        assert!((0..2_000).all(|k| (t[k] - 0.002 * k as f64).abs() < 1e-9), "{name}: {warnings:?}");
        assert!(name.ends_with("csv") || recording.signals.start == Some(NOW as i64 * 1_000_000_000));
        let again = watched(&tape, &[]);
        assert_eq!(["t", "highest_level"].map(|key| &again[key]), ["t", "highest_level"].map(|key| &live[key]));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), if name.ends_with("csv") { 4 } else { 2 });
    }
}

/// A message that the broker has kept, whatever its time, is left out, and so is its request to end.
#[test]
fn retained_messages_are_left_out() {
    common::at_root();
    let folder = tempfile::tempdir().unwrap();
    let Some(broker) = Broker::new(folder.path()) else { return };
    let _running = broker.start();
    let port = broker.port.to_string();
    let publish = |arguments: &[&str], message: &str| {
        let mut sender = Command::new("mosquitto_pub");
        sender.args(["-p", &port, "-t", "robot/joints", "-q", "1", "-m", message]).args(arguments);
        assert!(sender.status().unwrap().success());
    };
    let message = |start: u64, first: u64| {
        let rows: Vec<[String; 3]> = (first..first + 250).map(|k| row(start, k)).collect();
        let list = |i: usize, [open, close]: [&str; 2]| {
            rows.iter().map(|row| format!("{open}{}{close}", row[i])).collect::<Vec<_>>().join(",")
        };
        let [t, q, tau] = [list(0, ["", ""]), list(1, ["[", "]"]), list(2, ["[", "]"])];
        format!("{{\"t\": [{t}], \"q\": [{q}], \"tau\": [{tau}]}}")
    };
    for (n, kept) in [message(0, 0), message(2 * NOW, 0), r#"{"end": true}"#.into()].iter().enumerate() {
        publish(&["-r"], kept);
        let tape = path(&folder, &format!("{n}.mcap"));
        let mut watch = program();
        watch.args(["watch", MODEL, "--mqtt", &broker.url(), "--topic", "robot/joints", "--json", "--idle", "6"]);
        watch.args(["-o", &tape, "--client-id", &format!("watch-{n}")]);
        let watch = watch.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        std::thread::sleep(Duration::from_secs(3));
        for part in 0..4 {
            publish(&[], &message(NOW, 250 * part));
        }
        let out = watch.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(out.status.code() == Some(0) && said.contains("retained message"), "{said}");
        let samples = &verdict(&out)["samples"];
        assert_eq!((samples["taken"].as_u64(), samples["unusable_messages"].as_u64()), (Some(1_000), Some(1)));
        let (recording, _) = deltatwin_io::recording::read(Path::new(&tape), None).unwrap();
        assert_eq!(recording.signals.len(), 1_000);
    }
}

/// Runs `openssl` in a folder.
fn openssl(folder: &Path, arguments: &str) {
    let out = Command::new("openssl").current_dir(folder).args(arguments.split(' ')).output().unwrap();
    assert!(out.status.success(), "{arguments}: {}", String::from_utf8_lossy(&out.stderr));
}

/// A broker with a certificate of `ca.pem` for localhost, and with the user `robot` whose password is `geheim`.
fn guarded(folder: &Path) -> Option<Broker> {
    if Command::new("openssl").arg("version").stdout(Stdio::null()).status().is_err() {
        eprintln!("not tested: openssl is not installed");
        return None;
    }
    let key = "-newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes";
    for name in ["ca", "other"] {
        openssl(folder, &format!("req -x509 {key} -days 2 -subj /CN={name} -keyout {name}.key -out {name}.pem"));
    }
    std::fs::write(folder.join("names"), "subjectAltName=DNS:localhost,IP:127.0.0.1\n").unwrap();
    openssl(folder, &format!("req {key} -subj /CN=localhost -keyout server.key -out server.csr"));
    openssl(
        folder,
        "x509 -req -in server.csr -CA ca.pem -CAkey ca.key -CAcreateserial -days 2 -extfile names -out server.pem",
    );
    let here = folder.display();
    let broker = Broker::with(
        folder,
        &format!(
            "certfile {here}/server.pem\nkeyfile {here}/server.key\nallow_anonymous false\npassword_file {here}/users"
        ),
    )?;
    let users =
        Command::new("mosquitto_passwd").current_dir(folder).args(["-b", "-c", "users", "robot", "geheim"]).status();
    assert!(users.unwrap().success());
    Some(broker)
}

/// A broker with a certificate and a login: who has both gets in, nobody else, and no output shows the password.
#[test]
fn a_broker_with_tls_is_verified_and_its_password_is_never_shown() {
    common::at_root();
    let folder = tempfile::tempdir().unwrap();
    let Some(broker) = guarded(folder.path()) else { return };
    let _running = broker.start();
    let [ca, other, login, csv] = ["ca.pem", "other.pem", "login", "run.csv"].map(|name| path(&folder, name));
    std::fs::write(&login, "robot\ngeheim\n").unwrap();
    let mode = |mode: u32| {
        std::fs::set_permissions(&login, std::os::unix::fs::PermissionsExt::from_mode(mode)).unwrap();
    };
    mode(0o600);
    let url = format!("mqtts://localhost:{}", broker.port);
    // Of one that says what it did: status and output.
    let tried = |url: &str, arguments: &[&str], password: Option<&str>| {
        let mut watch = program();
        watch.args(["watch", MODEL, "--mqtt", url, "--topic", "robot/joints", "--idle", "1.5", "--json"]);
        watch.args(arguments).env("DELTATWIN_MQTT_USER", "robot");
        if let Some(password) = password {
            watch.env("DELTATWIN_MQTT_PASSWORD", password);
        }
        let out = watch.output().unwrap();
        let said = [out.stdout, out.stderr].map(|text| String::from_utf8_lossy(&text).into_owned()).concat();
        assert!(!said.contains("geheim"), "{said}");
        (out.status.code(), said)
    };
    let refused = |url: &str, arguments: &[&str], password: Option<&str>, why: &str| {
        let start = Instant::now();
        let (status, said) = tried(url, arguments, password);
        assert!(status == Some(2) && said.contains(why), "{why}: {said}");
        start.elapsed()
    };
    assert_eq!(tried(&url, &["--ca", &ca], Some("geheim")).0, Some(0));
    let time = refused(&url, &["--ca", &ca], Some("geheim-no"), "the broker refuses the login");
    assert!(time < Duration::from_secs(4), "{time:?}");
    refused(&url, &["--ca", &ca], None, "the broker refuses the login");
    refused(&url, &["--ca", &other], Some("geheim"), "certificate of the broker is not accepted");
    refused(&url, &[], Some("geheim"), "is not accepted");
    refused(&url, &["--ca", &login], Some("geheim"), "expected one or more in PEM");
    refused(&url.replace("localhost", "127.0.0.2"), &["--ca", &ca], Some("geheim"), "mqtts://127.0.0.2");
    refused(&url.replace("mqtts", "mqtt"), &["--ca", &ca], Some("geheim"), "expected mqtts://HOST");
    refused(&url.replace("mqtts", "mqtt"), &[], Some("geheim"), "no broker answers");
    // The login in a file, and in the address.
    assert_eq!(tried(&url, &["--ca", &ca, "--mqtt-login", &login], Some("wrong")).0, Some(0));
    assert_eq!(tried(&url.replace("//", "//robot:geheim@"), &["--ca", &ca], Some("wrong")).0, Some(0));
    refused(
        &url.replace("//", "//robot:geheim@"),
        &["--ca", &ca, "--mqtt-login", &login],
        None,
        "expected one of them",
    );
    mode(0o644);
    refused(&url, &["--ca", &ca, "--mqtt-login", &login], None, "chmod 600");
    // Whatever is wrong with the address or the command line.
    for wrong in ["mqtts://u:geheim@localhost:99999", "mqtts://u:geheim", "http://u:geheim@h", "mqtt://u:geheim@"] {
        refused(wrong, &[], None, "expected mqtt://HOST");
    }
    refused(&url, &["mqtts://u:it's geheim@localhost"], None, "unexpected argument");
    // Samples go the same way.
    let rows: Vec<String> = (0..500).map(|k| row(0, k).join(",")).collect();
    std::fs::write(&csv, format!("t,q1,q2,q3,q4,tau1,tau2,tau3,tau4\n{}\n", rows.join("\n"))).unwrap();
    mode(0o600);
    let mut watch = program();
    watch.args(["watch", MODEL, "--mqtt", &url, "--topic", "robot/joints", "--idle", "5", "--json", "--ca", &ca]);
    let watch = watch.args(["--mqtt-login", &login]).stdout(Stdio::piped()).spawn().unwrap();
    std::thread::sleep(Duration::from_secs(2));
    let mut replay = program();
    replay.args(["replay", &csv, "--mqtt", &url, "--topic", "robot/joints", "--ca", &ca, "--mqtt-login", &login]);
    assert!(replay.stdout(Stdio::null()).status().unwrap().success());
    assert_eq!(verdict(&watch.wait_with_output().unwrap())["samples"]["taken"], 500);
}

/// Damaged bytes anywhere cost a warning and what they are part of.
#[test]
fn a_damaged_bag_is_followed_beyond_the_damage() {
    common::at_root();
    let folder = tempfile::tempdir().unwrap();
    let tape = path(&folder, "run.mcap");
    let made = program().args(["simulate", "scenarios/smoke.toml", "-o", &tape]).stdout(Stdio::null()).status();
    assert!(made.unwrap().success());
    let bytes = std::fs::read(&tape).unwrap();
    let followed = |file: &str| {
        // Far less than what a length in the file asks for.
        let line = "ulimit -v 2000000; exec \"$0\" watch \"$1\" --follow \"$2\" --idle 1 --json";
        let mut watch = Command::new("sh");
        watch.args(["-c", line]).arg(assert_cmd::cargo::cargo_bin("deltatwin")).args([MODEL, file]);
        let out = watch.output().unwrap();
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(0), "{said}");
        (verdict(&out)["samples"]["taken"].as_u64().unwrap(), said)
    };
    let whole = followed(&tape).0;
    assert!(whole > 1_000);
    for k in 0..12 {
        let mut damaged = bytes.clone();
        damaged[k * bytes.len() / 12 + 5] ^= 0x10;
        std::fs::write(&tape, damaged).unwrap();
        let (taken, said) = followed(&tape);
        assert!(taken + 500 > whole, "{k}: {taken} of {whole} samples; {said}");
        assert!(taken == whole || said.contains("damaged"), "{k}: {said}");
    }
    assert_eq!(followed("tests/files/corpus/channel-length.mcap").0, 0);
}

/// A pipe is followed as a file is; who waits at its other end for nobody can be stopped.
#[test]
fn a_pipe_is_followed_and_does_not_hold_the_program() {
    common::at_root();
    let folder = tempfile::tempdir().unwrap();
    let pipe = path(&folder, "pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let follow = || {
        let mut watch = program();
        watch.args(["watch", MODEL, "--follow", &pipe, "--json"]).stdout(Stdio::piped());
        watch
    };
    let start = Instant::now();
    let out = follow().args(["--time-limit", "2"]).output().unwrap();
    assert!(start.elapsed() < Duration::from_secs(5), "{:?}", start.elapsed());
    assert_eq!(verdict(&out)["state"], "learning");
    let watch = follow().spawn().unwrap();
    std::thread::sleep(Duration::from_secs(1));
    assert!(Command::new("kill").args(["-INT", &watch.id().to_string()]).status().unwrap().success());
    let start = Instant::now();
    let out = watch.wait_with_output().unwrap();
    assert!(out.status.code() == Some(130) && start.elapsed() < Duration::from_secs(2), "{:?}", start.elapsed());
    assert_eq!(verdict(&out)["state"], "learning");
    // The writer comes later and leaves in between.
    let watch = follow().args(["--idle", "3"]).spawn().unwrap();
    let rows = |range: std::ops::Range<u64>| range.map(|k| row(NOW, k).join(",") + "\n").collect::<String>();
    std::thread::sleep(Duration::from_millis(500));
    std::fs::write(&pipe, format!("t,q1,q2,q3,q4,tau1,tau2,tau3,tau4\n{}", rows(0..1_500))).unwrap();
    std::thread::sleep(Duration::from_millis(500));
    std::fs::write(&pipe, rows(1_500..2_000)).unwrap();
    assert_eq!(verdict(&watch.wait_with_output().unwrap())["samples"]["taken"], 2_000);
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
        (&Value::from("learning"), Some(9))
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
    assert!(refused(&[]).contains("--mqtt"));
    assert!(refused(&["--mqtt", "127.0.0.1", "--topic", "a"]).contains("expected mqtt://HOST"));
    assert!(refused(&["--mqtt", "mqtt://127.0.0.1:9", "--topic", "a"]).contains("no broker answers"));
    assert!(refused(&["--follow", "none.csv"]).contains("none.csv"));
    assert!(refused(&["--follow", "Cargo.toml"]).contains("has no column `t`"));
    assert!(refused(&["--follow", "a.csv", "--healthy", "Cargo.toml"]).contains("Cargo.toml"));
}
