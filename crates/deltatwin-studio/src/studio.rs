//! A session that is worked on: its state, the work that goes on, and the data in memory.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use deltatwin::identification::fit::Fit;
use deltatwin::machine::Mechanism;
use deltatwin::model::Model;
use deltatwin_analysis::Data;
use deltatwin_analysis::law::TermError;
use deltatwin_analysis::page::quoted;
use deltatwin_io::model;
use deltatwin_io::model::shipped::SHIPPED;
use deltatwin_io::recording::{Mapping, setup};
use deltatwin_validation::demo::{EXAMPLE, hide, write_example};
use miette::{IntoDiagnostic, miette};
use serde_json::Value;

use crate::claim::Claim;
use crate::job::Job;
use crate::live::Live;
use crate::session::{How, Session, private};
use crate::stage::{self, Outcome};
use crate::upload::{self, Kept};

/// A session in a folder, which no other process has open.
pub struct Studio {
    folder: PathBuf,
    claim: Claim,
    inner: Mutex<Inner>,
}

/// What a request looks at and changes.
pub(crate) struct Inner {
    pub session: Session,
    pub job: Option<Arc<Job>>,
    /// Changes since the start, so that a window knows when to look again.
    pub revision: u64,
    /// What went wrong last; empty if nothing did.
    pub message: String,
    /// The typed term that it is about, from 0.
    pub term: Option<usize>,
    /// What the viewer shows, once something was asked for.
    pub shown: Option<Shown>,
    /// The machine that is watched, or was last.
    pub live: Option<Live>,
    data: Option<Loaded>,
    fit: Option<Fitted>,
}

/// What the viewer shows.
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) struct Shown {
    /// Number of the file, so that a window knows when there is another.
    pub serial: u64,
    /// The recording.
    pub recording: String,
    /// The model.
    pub version: usize,
    /// The commands that show the same outside of the studio.
    pub commands: Vec<String>,
}

/// A fit in memory, with the model that it made and the state of the recordings.
struct Fitted {
    generation: u64,
    version: usize,
    fit: Arc<Fit>,
}

/// Data in memory, with what they depend on.
struct Loaded {
    generation: u64,
    machine: (Mechanism, bool),
    data: Arc<Data>,
}

/// What a stage works with.
pub(crate) struct Task {
    /// The session when the stage began.
    pub session: Session,
    /// Its folder.
    pub folder: PathBuf,
    /// The model in use.
    pub model: Model,
    /// Its version.
    pub version: usize,
    /// The recordings.
    pub data: Arc<Data>,
    /// The fit that made the model in use, if it is in memory.
    pub fit: Option<Arc<Fit>>,
}

impl Studio {
    /// The session of `folder`, which is created if it does not exist.
    ///
    /// # Errors
    /// If the folder cannot be created, is open in another studio, or holds a session that cannot be read.
    pub fn open(folder: &Path) -> miette::Result<Self> {
        private(folder).into_diagnostic()?;
        let folder = folder.canonicalize().into_diagnostic()?;
        let claim = Claim::take(&folder)?;
        let session = Session::read(&folder)?;
        upload::clean(&folder);
        let inner = Inner {
            session,
            job: None,
            revision: 1,
            message: String::new(),
            term: None,
            shown: None,
            live: None,
            data: None,
            fit: None,
        };
        Ok(Self { folder, claim, inner: Mutex::new(inner) })
    }

    /// Folder of the session.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Notes where this studio answers, for whoever opens the folder meanwhile.
    ///
    /// # Errors
    /// If that cannot be written.
    pub(crate) fn note(&self, address: SocketAddr) -> miette::Result<()> {
        self.claim.note(address).into_diagnostic()
    }

    /// The state; what a thread that failed has left is as good as any.
    pub(crate) fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the session and writes it; without the file nothing has changed.
    fn change<T>(&self, change: impl FnOnce(&mut Session) -> miette::Result<T>) -> miette::Result<T> {
        let mut inner = self.lock();
        let mut next = inner.session.clone();
        let result = change(&mut next)?;
        next.write(&self.folder)?;
        inner.session = next;
        inner.revision += 1;
        inner.message.clear();
        Ok(result)
    }

    /// Keeps a file that came in.
    ///
    /// # Errors
    /// As for [`upload::keep`], or if something else is being worked on.
    pub(crate) fn take(&self, name: &str, source: &mut dyn std::io::Read) -> miette::Result<Kept> {
        self.add(upload::keep(&self.folder, name, source)?, "uploaded")
    }

    /// Keeps the files of a bag that came in.
    ///
    /// # Errors
    /// As for [`upload::keep_bag`].
    pub(crate) fn take_bag(
        &self,
        name: &str,
        parts: &[(String, u64)],
        source: &mut dyn std::io::Read,
    ) -> miette::Result<Kept> {
        self.add(upload::keep_bag(&self.folder, name, parts, source)?, "uploaded")
    }

    /// Adds a file that was kept to the session; a model is called `what`.
    fn add(&self, kept: Kept, what: &str) -> miette::Result<Kept> {
        self.change(|session| {
            match &kept {
                Kept::Recording(file) => session.add(file.clone()),
                Kept::Model(file) => session.begin_with(file, what),
                Kept::Setup(_) => {}
            }
            session.changed(&self.folder)
        })?;
        Ok(kept)
    }

    /// Does what a window asks for.
    ///
    /// # Errors
    /// If it is not possible; the session is then as before.
    pub(crate) fn act(self: &Arc<Self>, request: &Value) -> miette::Result<()> {
        let text = |key: &str| request[key].as_str().unwrap_or_default();
        let index = |key: &str| request[key].as_u64().map(|k| k as usize);
        match text("do") {
            "cancel" => {
                let mut inner = self.lock();
                if let Some(job) = inner.job.take() {
                    job.cancel();
                    inner.message = format!("`{}` is cancelled; nothing has changed", job.stage);
                    inner.revision += 1;
                }
                Ok(())
            }
            "hold_out" => self.idle()?.change(|s| {
                let recording = index("recording").and_then(|k| s.recordings.get_mut(k));
                let recording = recording.ok_or_else(|| miette!("there is no such recording"))?;
                recording.held_out = !recording.held_out;
                s.changed(&self.folder)
            }),
            "leave_out" => self.idle()?.change(|s| {
                s.leave_out(index("recording"))?;
                s.changed(&self.folder)
            }),
            "shipped" => self.idle()?.ship(text("model").trim_end_matches(".toml")),
            "example" => {
                let studio = self.idle()?;
                if !studio.lock().session.recordings.is_empty() {
                    return Err(miette!("the session has recordings; an example is for an empty one"));
                }
                studio.begin("example", |studio, job| studio.example(job))
            }
            "read" => {
                let how: How = serde_json::from_value(request["how"].clone()).into_diagnostic()?;
                self.idle()?.change(|s| {
                    // A new assignment is of columns of the files, which earlier ones would have read already.
                    let new = how.maps.iter().any(|map| !s.how.maps.contains(map));
                    s.how = how;
                    s.inputs(Path::new(""))?;
                    if new {
                        s.recordings.iter().try_for_each(|r| r.set_maps(&self.folder, &[]))?;
                    }
                    s.changed(&self.folder)
                })
            }
            "remedy" => self.idle()?.change(|s| {
                let map: Mapping = text("map").parse().map_err(|e| miette!("map \"{}\": {e}", text("map")))?;
                let file = text("recording");
                let own = s.recordings.iter().position(|r| r.file == file);
                s.remap(&self.folder, own, |maps| {
                    maps.push(map);
                    Ok(())
                })?;
                s.changed(&self.folder)
            }),
            "weigh" => self.idle()?.change(|s| {
                let own = s.recordings.iter().position(|r| r.file == text("recording"));
                let mass = request["mass"].as_f64().ok_or_else(|| miette!("the mass is missing"))?;
                s.weigh(&self.folder, own, mass)?;
                s.changed(&self.folder)
            }),
            "without" => self.idle()?.change(|s| {
                s.remap(&self.folder, index("recording"), |maps| {
                    let k = index("map")
                        .filter(|k| *k < maps.len())
                        .ok_or_else(|| miette!("the recording has {} maps; this is not one of them", maps.len()))?;
                    maps.remove(k);
                    Ok(())
                })?;
                s.changed(&self.folder)
            }),
            "version" => self.idle()?.change(|s| {
                let k = index("version").filter(|k| *k < s.versions.len());
                s.current = Some(k.ok_or_else(|| miette!("there is no such version"))?);
                Ok(())
            }),
            "undo" => self.idle()?.change(|s| {
                let parent = s.current.and_then(|k| s.versions[k].parent);
                s.current = Some(parent.ok_or_else(|| miette!("this is the first model"))?);
                Ok(())
            }),
            "check" => self.start("check", stage::check),
            "fit" => self.checked()?.start("fit", stage::fit),
            "where" => self.checked()?.start("where", stage::locate),
            "why" => self.checked()?.start("why", stage::diagnose),
            "add" => {
                let effect = text("effect").to_string();
                let laws: Vec<String> = serde_json::from_value(request["laws"].clone()).unwrap_or_default();
                self.checked()?.start("add", move |task, job| stage::add(task, job, &effect, &laws))
            }
            #[cfg(feature = "viewer")]
            "view" => {
                let (recording, studio) = (index("recording"), self.clone());
                self.start("view", move |task, _| studio.show(task, recording))
            }
            "watch" => self.watch(request),
            "unwatch" => {
                self.lock().live.iter().for_each(Live::stop);
                Ok(())
            }
            "save" => {
                let session = self.lock().session.clone();
                crate::view::save(&self.folder, &session)?;
                self.lock().revision += 1;
                Ok(())
            }
            other => Err(miette!("nothing is called `{other}`")),
        }
    }

    /// Watches a machine that runs with the model in use: a file that grows, or a topic of a broker.
    fn watch(&self, request: &Value) -> miette::Result<()> {
        let text = |key: &str| request[key].as_str().unwrap_or_default().trim();
        let mut inner = self.lock();
        if inner.live.as_ref().is_some_and(Live::is_running) {
            return Err(miette!("a machine is being watched; end that first"));
        }
        let session = &inner.session;
        let model = session.current.map(|k| session.versions[k].file.clone());
        let mut words = vec!["watch".into(), model.ok_or_else(|| miette!("choose a model first"))?];
        // The setup of what is watched stands beside the file, or is that of the healthy recording.
        let mut beside = None;
        match (text("follow"), text("mqtt"), text("topic")) {
            ("", "", _) => return Err(miette!("name the file that grows, or the broker and its topic")),
            ("", _, "") => return Err(miette!("the topic of the samples is missing")),
            ("", address, topic) => words.extend([format!("--mqtt={address}"), format!("--topic={topic}")]),
            (file, ..) => {
                let file = std::path::absolute(file).into_diagnostic()?;
                words.push(format!("--follow={}", file.display()));
                beside = Some(setup::sidecar(&file)).filter(|beside| beside.is_file());
            }
        }
        match session.recordings.iter().find(|r| r.file == text("healthy")) {
            Some(recording) => {
                words.push(format!("--healthy={}", recording.file));
                let own = recording.payload_mass(&self.folder)?.map(|_| setup::sidecar(Path::new(&recording.file)));
                beside = beside.or(own);
            }
            None => words.extend(request["learn"].as_f64().map(|seconds| format!("--learn={seconds}"))),
        }
        words.extend(beside.map(|file| format!("--setup={}", file.display())));
        words.extend(request["idle"].as_f64().map(|seconds| format!("--idle={seconds}")));
        let program = std::env::current_exe().into_diagnostic()?;
        inner.live = Some(Live::start(&program, &self.folder, &words)?);
        inner.revision += 1;
        Ok(())
    }

    /// Writes the file of the viewer: a recording, the last one that is held out unless another is asked for, with the
    /// model in use beside the one that it was made from.
    #[cfg(feature = "viewer")]
    fn show(&self, task: &Task, recording: Option<usize>) -> miette::Result<Outcome> {
        let shown = crate::viewer::write(task, recording)?;
        let mut inner = self.lock();
        let serial = inner.shown.as_ref().map_or(1, |last| last.serial + 1);
        inner.shown = Some(Shown { serial, ..shown });
        Ok(Outcome::default())
    }

    /// Itself if nothing is being worked on.
    fn idle(self: &Arc<Self>) -> miette::Result<&Arc<Self>> {
        match &self.lock().job {
            Some(job) => Err(miette!("wait for `{}` to end, or cancel it", job.stage)),
            None => Ok(self),
        }
    }

    /// Itself if the check has passed.
    fn checked(self: &Arc<Self>) -> miette::Result<&Arc<Self>> {
        let passed = self.lock().session.stages.get("check").is_some_and(|c| c.good);
        if passed { Ok(self) } else { Err(miette!("the recordings are not checked, or do not belong to the model")) }
    }

    /// Simulates the two recordings of `deltatwin example`, and takes them with their model.
    fn example(&self, job: &Job) -> miette::Result<()> {
        let (seed, name) = EXAMPLE;
        let model = model::read(Path::new(name))?;
        job.expect(SECONDS_OF_EXAMPLE);
        job.at((0.0, 1.0), "two motions of a robot");
        let campaign = hide(&model, seed, None).into_diagnostic()?.prepared.record(&model, &|_, _| ());
        let trial = upload::Trial::new(&self.folder)?;
        let [first, second, hidden] = write_example(&campaign.into_diagnostic()?, &trial.folder)?;
        if job.is_cancelled() {
            return Ok(());
        }
        // The setups state the payload, so they come before their recordings.
        for file in [setup::sidecar(&first), setup::sidecar(&second), first, second] {
            let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            self.take(&name, &mut std::fs::File::open(&file).into_diagnostic()?)?;
        }
        std::fs::rename(hidden, self.folder.join("hidden.txt")).into_diagnostic()?;
        self.ship(name)
    }

    /// Begins with the shipped model `name`.
    fn ship(&self, name: &str) -> miette::Result<()> {
        let found = SHIPPED.iter().find(|(known, _)| name == *known);
        let (_, content) = found.ok_or_else(|| miette!("`{name}` is not a shipped model"))?;
        let kept = upload::keep(&self.folder, &format!("{name}.toml"), &mut content.as_bytes())?;
        self.add(kept, "shipped").map(drop)
    }

    /// Starts a stage in the background; its outcome is kept if nothing it depends on has changed.
    fn start(
        self: &Arc<Self>,
        stage: &'static str,
        work: impl FnOnce(&Task, &Job) -> miette::Result<Outcome> + Send + 'static,
    ) -> miette::Result<()> {
        self.begin(stage, move |studio, job| {
            let task = studio.task(job)?;
            job.expect(stage::seconds_per_sample(stage) * task.samples() as f64);
            let outcome = work(&task, job)?;
            studio.keep(job, &outcome, task.session.generation)
        })
    }

    /// Starts work in the background.
    fn begin(
        self: &Arc<Self>,
        stage: &'static str,
        work: impl FnOnce(&Self, &Job) -> miette::Result<()> + Send + 'static,
    ) -> miette::Result<()> {
        let job = Arc::new(Job::new(stage));
        {
            let mut inner = self.lock();
            if let Some(job) = &inner.job {
                return Err(miette!("wait for `{}` to end, or cancel it", job.stage));
            }
            inner.job = Some(job.clone());
            inner.message.clear();
            inner.term = None;
            inner.revision += 1;
        }
        let studio = self.clone();
        std::thread::spawn(move || {
            let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| work(&studio, &job)));
            studio.end(&job, done.unwrap_or_else(|_| Err(miette!("the stage `{stage}` failed unexpectedly"))));
        });
        Ok(())
    }

    /// Keeps the outcome of a stage that was not cancelled.
    fn keep(&self, job: &Job, outcome: &Outcome, generation: u64) -> miette::Result<()> {
        if job.is_cancelled() {
            return Ok(());
        }
        if self.lock().session.generation != generation {
            return Err(miette!("the data have changed while {} was running", job.stage));
        }
        let basis = self.lock().session.basis.clone();
        outcome.write(&self.folder, &basis)?;
        self.change(|session| {
            outcome.apply(session);
            Ok(())
        })?;
        if let Some((fit, ..)) = &outcome.fit {
            let mut inner = self.lock();
            let version = inner.session.versions.len() - 1;
            inner.fit = Some(Fitted { generation, version, fit: fit.clone() });
        }
        Ok(())
    }

    /// Ends the work that goes on, with a message if it failed.
    fn end(&self, job: &Job, done: miette::Result<()>) {
        let mut inner = self.lock();
        // A cancellation that came meanwhile has made room for another stage.
        if job.is_cancelled() {
            return;
        }
        inner.job = None;
        inner.revision += 1;
        if let Err(error) = done {
            inner.term = error.downcast_ref::<TermError>().map(|fault| fault.term);
            let text = error.chain().map(ToString::to_string).collect::<Vec<_>>().join(": ");
            inner.message = text.replace(&format!("{}/", self.folder.display()), "");
        }
    }

    /// What a stage works with; the data are read if they are not in memory.
    fn task(&self, job: &Job) -> miette::Result<Task> {
        let session = self.lock().session.clone();
        let version = session.current.ok_or_else(|| miette!("there is no model yet; choose or drop one"))?;
        if !session.recordings.iter().any(|r| !r.held_out) {
            return Err(miette!("there is no recording to fit to; drop one"));
        }
        let model = model::read(&self.folder.join(&session.versions[version].file))?;
        let machine = (model.mechanism, model.assembled);
        let known = |l: &&Loaded| l.generation == session.generation && l.machine == machine;
        let loaded = self.lock().data.as_ref().filter(known).map(|l| l.data.clone());
        let data = match loaded {
            Some(data) => data,
            None => {
                job.at((0.0, 0.0), "reading");
                let data = Arc::new(Data::read(&session.inputs(&self.folder)?, &model)?);
                let loaded = Loaded { generation: session.generation, machine, data: data.clone() };
                self.lock().data = Some(loaded);
                data
            }
        };
        let known = |f: &&Fitted| f.generation == session.generation && f.version == version;
        let fit = self.lock().fit.as_ref().filter(known).map(|f| f.fit.clone());
        Ok(Task { session, folder: self.folder.clone(), model, version, data, fit })
    }
}

/// Expected time of simulating the example on two cores, s.
const SECONDS_OF_EXAMPLE: f64 = 8.0;

/// A command line from its words.
pub(crate) fn line(words: &[String]) -> String {
    words.iter().map(|w| quoted(w)).collect::<Vec<_>>().join(" ")
}
