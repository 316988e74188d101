//! Streaming of scenes to a running viewer, piece by piece.

use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

use rerun::RecordingStream;

use super::known::Known;
use super::{APPLICATION, Outcome, Problem, Scene, layout, motion, shapes, trail};

/// Time limit for an answer of the viewer, s.
const PATIENCE: Duration = Duration::from_secs(5);

/// The viewer that receives the stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Viewer {
    /// A viewer that listens at this URL, such as `rerun+http://127.0.0.1:9876/proxy`.
    Connect(String),
    /// A viewer on this machine, started if none is running; `rerun` must be in the path.
    Spawn,
}

/// A stream to a viewer, with a bounded buffer: sending blocks while it is full.
pub struct Live {
    rec: RecordingStream,
    staged: bool,
    known: Known,
}

impl Live {
    /// Opens a stream called `name` with a layout for pieces like `scene`.
    ///
    /// # Errors
    /// If no viewer answers or none can be started, or the URL is not valid.
    pub fn open(viewer: &Viewer, name: &str, scene: &Scene) -> Result<Self, Problem> {
        let builder = rerun::RecordingStreamBuilder::new(APPLICATION).recording_name(name).enabled(true);
        let rec = match viewer {
            Viewer::Connect(url) => {
                listens(url)?;
                builder.connect_grpc_opts(url.as_str())?
            }
            Viewer::Spawn => builder.spawn()?,
        };
        layout(scene).send(&rec)?;
        Ok(Self { rec, staged: false, known: Known::default() })
    }

    /// Sends a piece; the first one is preceded by the shapes of robot and surroundings.
    ///
    /// # Errors
    /// If the stream is closed.
    pub fn send(&mut self, scene: &Scene) -> Outcome {
        // A piece without frames does not show whether the robot is assembled.
        if !self.staged && !scene.times.is_empty() {
            shapes(&self.rec, scene)?;
            self.staged = true;
        }
        trail::end(&self.rec, scene, &mut self.known)?;
        motion(&self.rec, scene, &mut self.known)
    }

    /// Waits until the viewer has received everything.
    ///
    /// # Errors
    /// If the viewer is gone or does not answer in time.
    pub fn finish(&self) -> Outcome {
        Ok(self.rec.flush_with_timeout(PATIENCE)?)
    }
}

/// Checks that a server listens at `url`, since the SDK would retry without end.
fn listens(url: &str) -> Result<(), Problem> {
    let expected = "expected an address like rerun+http://127.0.0.1:9876/proxy";
    let place = url.split_once("://").map(|(_, rest)| rest.split('/').next().unwrap_or_default());
    let Some(place) = place.filter(|p| p.contains(':')) else { return Err(expected.into()) };
    let addresses = place.to_socket_addrs().map_err(|e| format!("{e}; {expected}"))?;
    let mut last = format!("no address; {expected}");
    for address in addresses {
        match TcpStream::connect_timeout(&address, PATIENCE) {
            Ok(_) => return Ok(()),
            Err(e) => last = e.to_string(),
        }
    }
    Err(last.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_there_is_an_error_at_once() {
        let e = listens("nonsense").unwrap_err().to_string();
        assert!(e.contains("expected an address like rerun+http"), "{e}");
        // A port that was free immediately before.
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let e = listens(&format!("rerun+http://127.0.0.1:{port}/proxy")).unwrap_err().to_string();
        assert!(e.contains("refused"), "{e}");
    }
}
