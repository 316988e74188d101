//! Viewer of a running simulation.

use deltatwin::dynamics::Plant;
use deltatwin::twin::Options;
use deltatwin_rerun::scene::Viewer;
use deltatwin_rerun::stream::Stream;

/// A viewer to stream to.
#[derive(clap::Args, Clone, Debug)]
pub struct View {
    /// Stream to the Rerun viewer at this address while the twin runs, such as rerun+http://127.0.0.1:9876/proxy.
    #[arg(long, value_name = "URL", conflicts_with = "spawn")]
    connect: Option<String>,
    /// Stream to a Rerun viewer on this machine, which is started if none runs; `rerun` must be in the path.
    #[arg(long)]
    spawn: bool,
}

impl View {
    /// Whether a stream was requested.
    pub fn wanted(&self) -> bool {
        self.spawn || self.connect.is_some()
    }

    /// Opens the requested stream with a frame every `spacing` s; without a viewer it prints a warning and returns
    /// `None`.
    pub fn open(&self, name: &str, plant: &Plant, options: &mut Options, spacing: f64) -> Option<Stream> {
        let viewer = match &self.connect {
            Some(url) => Viewer::Connect(url.clone()),
            None if self.spawn => Viewer::Spawn,
            None => return None,
        };
        match Stream::open(&viewer, name, plant, options, spacing) {
            Ok((stream, watcher)) => {
                options.watcher = Some(watcher);
                Some(stream)
            }
            Err(problem) => {
                let who = self.connect.as_deref().unwrap_or("rerun");
                crate::terminal::complain(format!("warning: {who}: {problem}; the run goes on without a viewer"));
                None
            }
        }
    }
}
