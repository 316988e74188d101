//! A viewer to stream to.

use deltatwin::dynamics::Plant;
use deltatwin::twin::Options;
use deltatwin_rerun::scene::Viewer;
use deltatwin_rerun::stream::Stream;

/// A viewer to stream to.
#[derive(clap::Args, Clone, Debug)]
pub struct View {
    /// Stream to the Rerun viewer at this address, such as rerun+http://127.0.0.1:9876/proxy.
    #[arg(long, value_name = "URL", conflicts_with = "spawn")]
    connect: Option<String>,
    /// Stream to a Rerun viewer on this machine, which is started if none runs; `rerun` must be in the path.
    #[arg(long)]
    spawn: bool,
}

impl View {
    /// The viewer that was asked for.
    pub fn viewer(&self) -> Option<Viewer> {
        match &self.connect {
            Some(url) => Some(Viewer::Connect(url.clone())),
            None => self.spawn.then_some(Viewer::Spawn),
        }
    }

    /// Prints why there is no viewer.
    pub fn refuse(&self, problem: &str) {
        let who = self.connect.as_deref().unwrap_or("rerun");
        crate::terminal::complain(format!("warning: {who}: {problem}; goes on without a viewer"));
    }
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
        self.viewer().is_some()
    }

    /// The viewer that was asked for.
    pub fn viewer(&self) -> Option<Viewer> {
        self.view.viewer().or_else(|| self.live.then_some(Viewer::Spawn))
    }

    /// Whether to stream in real time.
    pub fn is_live(&self) -> bool {
        self.live
    }

    /// Prints why there is no viewer.
    pub fn refuse(&self, problem: &str) {
        self.view.refuse(problem);
    }

    /// Opens the requested stream of a run with a frame every `spacing` s; without a viewer it prints a warning and
    /// returns `None`.
    pub fn open(&self, name: &str, plant: &Plant, options: &mut Options, spacing: f64) -> Option<Stream> {
        match Stream::open(&self.viewer()?, name, plant, options, spacing) {
            Ok((stream, watcher)) => {
                options.watcher = Some(watcher);
                Some(stream)
            }
            Err(problem) => {
                self.refuse(&problem);
                None
            }
        }
    }
}
