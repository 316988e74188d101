//! `deltatwin studio`.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use serde_json::json;

use crate::terminal::{DONE, catch_interrupt, interrupted, path, say};
use deltatwin_studio::{Studio, serve};

/// The loop in a browser: drop recordings, check, fit, see where the model fails and why, add the effect, save.
///
/// The server answers on this machine alone, to whom has the printed address. The session is a folder with recordings,
/// models, results and the commands that give them.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Example: deltatwin studio my-robot")]
pub struct Args {
    /// Folder of the session, which is created or continued.
    #[arg(default_value = "studio", value_name = "FOLDER")]
    pub folder: PathBuf,
    /// Port on 127.0.0.1; a free one without it.
    #[arg(long, default_value_t = 0, value_name = "PORT")]
    pub port: u16,
    /// One JSON object on stdout, with the address.
    #[arg(long)]
    pub json: bool,
}

/// Serves until Ctrl-C; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let server = serve(Studio::open(&args.folder)?, args.port)?;
    if args.json {
        say(json!({"url": server.url(), "folder": path(&args.folder)}))?;
    } else {
        say(format!(
            "Studio of {}\n  open {}\n  Ctrl-C ends it; the folder keeps everything",
            args.folder.display(),
            server.url()
        ))?;
    }
    catch_interrupt()?;
    let ended = AtomicBool::new(false);
    let served = std::thread::scope(|scope| {
        scope.spawn(|| {
            while !interrupted() && !ended.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(100));
            }
            server.stop();
        });
        let served = server.run();
        ended.store(true, Ordering::Relaxed);
        served
    });
    served.map(|()| DONE)
}
