//! Rerun's web viewer beside the page: its program, the page around it, and the file that it shows.

use std::path::Path;
use std::sync::OnceLock;

use deltatwin_io::outside::Access;
use deltatwin_io::{model, recording};
use deltatwin_rerun::replay::Replay;
use http_body_util::{BodyExt, StreamBody};
use hyper::StatusCode;
use hyper::body::Frame;
use hyper::header::{CACHE_CONTROL, CONTENT_LENGTH, CONTENT_TYPE};
use miette::miette;
use re_web_viewer_server::{WebViewerData, WebViewerDataError};
use tokio_stream::StreamExt;
use tokio_util::io::ReaderStream;

use crate::http::{BYTES, HTML, JAVASCRIPT, refusal, within};
use crate::server::{Answer, answer, streamed};
use crate::session::private;
use crate::studio::{Shown, Task, line};

/// The file that is shown, in the folder of the session.
const FILE: &str = "stages/view.rrd";
/// Size of a piece of it that is sent, bytes.
const PIECE: usize = 256 << 10;
const PAGE: &str = include_str!("../assets/viewer.html");
const SCRIPT: &str = include_str!("../assets/viewer.js");

/// What the viewer's page may load and run: scripts and WebAssembly of this server; it is shown in the studio's page only.
const POLICY: &str = "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'unsafe-inline'; \
     connect-src 'self'; img-src 'self' data: blob:; worker-src 'self' blob:; base-uri 'none'; form-action 'none'; \
     frame-ancestors 'self'";

/// Whether `path` is that of a file of the viewer's program.
pub(crate) fn is_asset(path: &str) -> bool {
    ["/viewer.js", "/re_viewer.js", "/re_viewer_bg.wasm"].contains(&path)
}

/// A file of the viewer's program.
pub(crate) fn asset(path: &str) -> Answer {
    static DATA: OnceLock<Result<WebViewerData, WebViewerDataError>> = OnceLock::new();
    if path == "/viewer.js" {
        return within(POLICY, SCRIPT, JAVASCRIPT);
    }
    let data = match DATA.get_or_init(|| WebViewerData::load(None)) {
        Ok(data) => data,
        Err(e) => return refusal(StatusCode::NOT_FOUND, &e.to_string()),
    };
    let (content, kind) = match path {
        "/re_viewer.js" => (data.viewer_js(), JAVASCRIPT),
        _ => (data.viewer_wasm(), "application/wasm"),
    };
    // The same for every session: the browser may keep it.
    answer(content, &[(CONTENT_TYPE, kind), (CACHE_CONTROL, "max-age=86400")])
}

/// The page around the viewer.
pub(crate) fn page() -> Answer {
    within(POLICY, PAGE, HTML)
}

/// The file that is shown.
pub(crate) fn file(folder: &Path) -> Answer {
    let opened = std::fs::File::open(folder.join(FILE)).and_then(|file| Ok((file.metadata()?.len(), file)));
    let Ok((length, file)) = opened else {
        return refusal(StatusCode::NOT_FOUND, "there is nothing to be shown yet");
    };
    let pieces = ReaderStream::with_capacity(tokio::fs::File::from_std(file), PIECE).map(|p| p.map(Frame::data));
    let mut answer =
        streamed(StreamBody::new(pieces).boxed_unsync(), &[(CONTENT_TYPE, BYTES), (CACHE_CONTROL, "no-store")]);
    answer.headers_mut().insert(CONTENT_LENGTH, length.into());
    answer
}

/// Writes the file: recording `index`, or the last one, held out if there is one, with the residual of the model in use;
/// beside it, as before and after, that of the model from which it was made.
pub(crate) fn write(task: &Task, index: Option<usize>) -> miette::Result<Shown> {
    let all = &task.session.recordings;
    let last = all.iter().rposition(|r| r.held_out).or(all.len().checked_sub(1));
    let index = index.or(last).filter(|k| *k < all.len()).ok_or_else(|| miette!("there is no such recording"))?;
    let named = &all[index].file;
    let inputs = task.session.inputs(&task.folder)?;
    let reading = inputs.reading(Some(task.model.mechanism));
    let (recording, _) = recording::read_as(&task.folder.join(named), &reading)?;
    let contacts = recording::contacts(&task.folder.join(named))?;
    let version = &task.session.versions[task.version];
    let parent = version.parent.map(|k| task.session.versions[k].file.as_str());
    let earlier = parent.map(|file| model::read(&task.folder.join(file))).transpose()?;
    let (model, beside) = match &earlier {
        Some(earlier) => (earlier, Some(&task.model)),
        None => (&task.model, None),
    };
    let path = task.folder.join(FILE);
    if let Some(folder) = path.parent() {
        private(folder).map_err(|e| miette!("{}: {e}", folder.display()))?;
    }
    Replay { recording: &recording, dataset: None, contacts: &contacts, model, beside, access: Access::PROJECT }
        .write(&path)?;
    let mut words = vec!["deltatwin", "replay", named.as_str(), "--model", parent.unwrap_or(&version.file)];
    if parent.is_some() {
        words.extend(["--beside", version.file.as_str()]);
    }
    let replay = line(&words.iter().map(ToString::to_string).collect::<Vec<_>>());
    let native = line(&["rerun".into(), path.display().to_string()]);
    Ok(Shown { serial: 0, recording: named.clone(), version: task.version, commands: vec![native, replay] })
}
