//! A viewer to stream to.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use deltatwin::twin::Options;
use deltatwin_rerun::scene::Viewer;
use deltatwin_rerun::show::Stage;
use deltatwin_rerun::stream::{Pace, Stream};
use deltatwin_rerun::web::WebViewer;

use crate::terminal::{complain, interrupted};

/// A viewer to stream to.
#[derive(clap::Args, Clone, Debug)]
pub struct View {
    /// Stream to the Rerun viewer at this address, such as rerun+http://127.0.0.1:9876/proxy.
    #[arg(long, value_name = "URL", conflicts_with_all = ["spawn", "serve"])]
    connect: Option<String>,
    /// Stream to a viewer in the browser, until Ctrl-C; `rerun` must be in the path.
    #[arg(long, conflicts_with = "spawn")]
    serve: bool,
    /// Stream to a Rerun viewer on this machine, which is started if none runs; `rerun` must be in the path.
    #[arg(long)]
    spawn: bool,
}

impl View {
    /// Whether a viewer was asked for.
    pub fn wanted(&self) -> bool {
        self.connect.is_some() || self.spawn || self.serve
    }

    /// The viewer that was asked for; one in the browser is started, and its address is printed.
    pub fn viewer(&self) -> Option<Viewer> {
        match &self.connect {
            Some(url) => Some(Viewer::Connect(url.clone())),
            None if self.serve => served().map(Viewer::Connect),
            None => self.spawn.then_some(Viewer::Spawn),
        }
    }

    /// Waits for Ctrl-C if the data are in a browser's viewer, which ends with this process.
    pub fn stay(&self) {
        if !self.serve || lock().is_none() {
            return;
        }
        complain("The page stays until Ctrl-C.");
        while !interrupted() {
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// Prints why there is no viewer.
    pub fn refuse(&self, problem: &str) {
        let who = self.connect.as_deref().unwrap_or("rerun");
        complain(format!("warning: {who}: {problem}; goes on without a viewer"));
    }
}

/// The web viewer of this process.
static SERVED: Mutex<Option<WebViewer>> = Mutex::new(None);

fn lock() -> MutexGuard<'static, Option<WebViewer>> {
    SERVED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Ends the web viewer of this process, if there is one.
pub fn end() {
    lock().take();
}

/// Address of the web viewer, which is started when it is first asked for; `None` if that fails.
fn served() -> Option<String> {
    let mut viewer = lock();
    if viewer.is_none() {
        match WebViewer::start() {
            Ok(started) => {
                complain(format!("Open {}", started.page()));
                *viewer = Some(started);
            }
            Err(problem) => complain(format!("warning: --serve: {problem}; goes on without a viewer")),
        }
    }
    viewer.as_ref().map(WebViewer::stream)
}

/// A viewer to stream to, and whether in real time.
#[derive(clap::Args, Clone, Debug)]
pub struct LiveView {
    #[command(flatten)]
    view: View,
    /// Stream in real time, to a viewer that is started if none runs, or to that of --connect.
    #[arg(long)]
    live: bool,
}

impl LiveView {
    /// Whether a stream was requested.
    pub fn wanted(&self) -> bool {
        self.view.wanted() || self.live
    }

    /// See [`View::stay`].
    pub fn stay(&self) {
        self.view.stay();
    }

    /// The viewer that was asked for.
    pub fn viewer(&self) -> Option<Viewer> {
        self.view.viewer().or_else(|| (self.live && !self.view.wanted()).then_some(Viewer::Spawn))
    }

    /// Whether to stream in real time.
    pub fn is_live(&self) -> bool {
        self.live
    }

    /// Prints why there is no viewer.
    pub fn refuse(&self, problem: &str) {
        self.view.refuse(problem);
    }

    /// Opens the requested stream of a run, whose `stage` is made for it; without a viewer it prints a warning and
    /// returns `None`.
    pub fn open(
        &self,
        name: &str,
        stage: impl FnOnce() -> miette::Result<Stage>,
        options: &mut Options,
    ) -> miette::Result<Option<Stream>> {
        let Some(viewer) = self.viewer() else { return Ok(None) };
        Ok(match Stream::open(&viewer, name, stage()?, if self.live { Pace::Live } else { Pace::Fast }) {
            Ok((stream, watcher)) => {
                options.watcher = Some(watcher);
                Some(stream)
            }
            Err(problem) => {
                self.refuse(&problem);
                None
            }
        })
    }
}
