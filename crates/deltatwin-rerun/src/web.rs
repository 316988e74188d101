//! The web viewer of the `rerun` in the path, for a browser on this machine.

use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Time in which the viewer must answer, s.
const PATIENCE: Duration = Duration::from_secs(15);
/// Most memory that it keeps for windows that come later; the oldest data go first.
const MEMORY: &str = "1GiB";

/// A web viewer that this process has started, and that ends with it.
pub struct WebViewer {
    process: Child,
    ports: [u16; 2],
}

impl WebViewer {
    /// Starts the viewer on two free ports of 127.0.0.1.
    ///
    /// # Errors
    /// If there is no `rerun` in the path, or it does not answer.
    pub fn start() -> Result<Self, String> {
        let ports = free_ports().map_err(|e| e.to_string())?;
        let mut command = Command::new("rerun");
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let process = command
            .args(["--serve-web", "--bind", "127.0.0.1", "--server-memory-limit", MEMORY])
            .args(["--port", &ports[0].to_string(), "--web-viewer-port", &ports[1].to_string()])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .map_err(|e| format!("`rerun` cannot be started: {e}; install it with `pip install rerun-sdk`"))?;
        let mut viewer = Self { process, ports };
        viewer.wait()?;
        Ok(viewer)
    }

    fn wait(&mut self) -> Result<(), String> {
        let begun = Instant::now();
        let answers = |port: u16| TcpStream::connect(SocketAddr::from((Ipv4Addr::LOCALHOST, port))).is_ok();
        while !self.ports.iter().all(|port| answers(*port)) {
            if let Ok(Some(status)) = self.process.try_wait() {
                return Err(format!("`rerun --serve-web` has ended: {status}"));
            }
            if begun.elapsed() > PATIENCE {
                return Err(format!("`rerun --serve-web` does not answer within {} s", PATIENCE.as_secs()));
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        Ok(())
    }

    /// Address to which data are streamed.
    pub fn stream(&self) -> String {
        format!("rerun+http://127.0.0.1:{}/proxy", self.ports[0])
    }

    /// Address for a browser.
    pub fn page(&self) -> String {
        let [data, page] = self.ports;
        format!("http://127.0.0.1:{page}/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{data}%2Fproxy")
    }
}

/// Two ports that nobody uses.
fn free_ports() -> std::io::Result<[u16; 2]> {
    // Both are held until both are known, so that they differ.
    let [first, second] = [0, 0].map(|any| TcpListener::bind((Ipv4Addr::LOCALHOST, any)));
    let (first, second) = (first?, second?);
    Ok([first.local_addr()?.port(), second.local_addr()?.port()])
}

impl Drop for WebViewer {
    fn drop(&mut self) {
        // It has no state to be saved. What is in the path may be a script that has started the viewer: the whole group.
        #[cfg(unix)]
        if let Some(group) = rustix::process::Pid::from_raw(self.process.id().cast_signed()) {
            let _ = rustix::process::kill_process_group(group, rustix::process::Signal::KILL);
        }
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
