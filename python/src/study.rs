//! [`StudyPlan`]: a study cut into chunks, each a pure function of the study and of its number.

use std::path::{Path, PathBuf};

use deltatwin_io::outside::Access;
use deltatwin_io::study;
use deltatwin_study::campaign::parquet::Reader;
use deltatwin_study::campaign::{self, Campaign, CampaignError, Chunk, Held, Kind, Value, Watch};
use deltatwin_study::conduct::{Conduct, ConductError};
use deltatwin_validation::exam::experiment::Experiments;
use pyo3::exceptions::{PyOSError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;

use crate::errors;
use crate::interrupt::{Bar, Task, run};
use crate::table::{Series, Table};

/// A study with the folder of its rows.
#[pyclass(frozen, module = "deltatwin")]
pub struct StudyPlan {
    study: PathBuf,
    folder: PathBuf,
    #[pyo3(get)]
    runs: u64,
    #[pyo3(get)]
    digest: String,
    #[pyo3(get)]
    build: String,
    #[pyo3(get)]
    is_search: bool,
}

/// What a study consists of: runs of a scenario, or experiments that hide effects in a model.
enum Work {
    Runs(Box<Conduct>),
    Experiments(Box<Experiments>),
}

impl Work {
    fn new(study: &Path, folder: &Path) -> miette::Result<Self> {
        let study = study::read(study, Access::with(deltatwin_cell::mesh::read))?;
        Ok(match study.experiment {
            None => Self::Runs(Conduct::new(study, folder)?.into()),
            Some(_) => Self::Experiments(Experiments::new(study, folder)?.into()),
        })
    }

    fn campaign(&self) -> &Campaign {
        match self {
            Self::Runs(conduct) => &conduct.campaign,
            Self::Experiments(experiments) => &experiments.campaign,
        }
    }

    fn runs(&self) -> u64 {
        match self {
            Self::Runs(conduct) => conduct.runs(),
            Self::Experiments(experiments) => experiments.runs(),
        }
    }

    fn is_search(&self) -> bool {
        matches!(self, Self::Runs(conduct) if conduct.is_search())
    }

    fn chunk(&self, chunk: Chunk, watch: &dyn Watch) -> Result<(), ConductError> {
        match self {
            Self::Runs(conduct) => conduct.chunk(chunk, watch),
            Self::Experiments(experiments) => Ok(experiments.chunk(chunk, watch)?),
        }
    }
}

impl StudyPlan {
    fn work(&self, py: Python) -> PyResult<Work> {
        Work::new(&self.study, &self.folder).map_err(|e| errors::report(py, &e))
    }
}

fn failed(error: &ConductError) -> PyErr {
    match error {
        ConductError::Campaign(CampaignError::Io { .. }) => PyOSError::new_err(error.to_string()),
        ConductError::Campaign(CampaignError::Interrupted) => PyRuntimeError::new_err("interrupted"),
        _ => PyValueError::new_err(error.to_string()),
    }
}

fn numbered(number: u64, of: u64) -> PyResult<Chunk> {
    Chunk::new(number, of)
        .ok_or_else(|| PyValueError::new_err(format!("chunk {number} of {of}; expected 1 to the number of chunks")))
}

/// Rows are counted and told; the task says when to stop.
struct Told<'t, T> {
    task: std::sync::Mutex<&'t Task<T>>,
    stop: std::sync::Arc<std::sync::atomic::AtomicBool>,
    done: std::sync::atomic::AtomicU64,
    of: u64,
}

impl<T: Send> Watch for Told<'_, T> {
    fn row(&self, _: &[Value], _: bool) {
        let done = self.done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
        if let Ok(task) = self.task.try_lock() {
            task.progress("study", done as f64 / self.of.max(1) as f64);
        }
    }

    fn stop(&self) -> bool {
        self.stop.load(std::sync::atomic::Ordering::Relaxed)
    }
}

#[pymethods]
impl StudyPlan {
    #[new]
    fn new(py: Python, study: PathBuf, folder: PathBuf) -> PyResult<Self> {
        errors::openable(&study)?;
        let work = Work::new(&study, &folder).map_err(|e| errors::report(py, &e))?;
        let (runs, is_search) = (work.runs(), work.is_search());
        let (digest, build) = (work.campaign().digest.hex(), work.campaign().build.clone());
        Ok(Self { study, folder, runs, digest, build, is_search })
    }

    #[getter]
    fn study(&self) -> PathBuf {
        self.study.clone()
    }

    #[getter]
    fn folder(&self) -> PathBuf {
        self.folder.clone()
    }

    /// File of a chunk's rows, which need not be there yet.
    fn part(&self, py: Python, number: u64, of: u64) -> PyResult<PathBuf> {
        let work = self.work(py)?;
        Ok(work.campaign().part(numbered(number, of)?))
    }

    /// Whether the table is there.
    #[getter]
    fn is_complete(&self, py: Python) -> PyResult<bool> {
        let work = self.work(py)?;
        Ok(work.campaign().held().map_err(|e| failed(&e.into()))? == Held::Table)
    }

    /// Compute the rows of chunk ``number`` of ``of`` that are not there yet, and return their file.
    ///
    /// A chunk is a pure function of the study (its ``digest``), of the program (its ``build``) and of the two numbers. ``threads`` is 0 for all cores.
    /// Computing the same chunk twice, after a kill, or with other threads gives the same bytes.
    #[pyo3(signature = (number = 1, of = 1, *, threads = 0, progress = None))]
    fn chunk(
        &self,
        py: Python,
        number: u64,
        of: u64,
        threads: usize,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<PathBuf> {
        let chunk = numbered(number, of)?;
        let work = self.work(py)?;
        let bar = Bar::of(py, progress, "study")?;
        let part = work.campaign().part(chunk);
        let pool = (threads > 0).then(|| {
            // One thread collects the rows, the others make them.
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads + 1).build();
            pool.map_err(|e| PyRuntimeError::new_err(e.to_string()))
        });
        let pool = pool.transpose()?;
        let range = chunk.range(work.runs());
        let done = run(py, bar.function(), move |task| {
            let told = Told {
                task: std::sync::Mutex::new(task),
                stop: task.stop_flag(),
                done: Default::default(),
                of: range.end - range.start,
            };
            let make = || work.chunk(chunk, &told);
            pool.map_or_else(make, |pool| pool.install(make))
        })?;
        done.map_err(|e| failed(&e))?;
        Ok(part)
    }

    /// Make the table of all parts, and return its file. Raises ``ValueError`` if parts are missing.
    fn merge(&self, py: Python) -> PyResult<PathBuf> {
        let work = self.work(py)?;
        let runs = (!work.is_search()).then(|| work.runs());
        py.detach(|| work.campaign().merge(runs).and_then(|_| work.campaign().remove_parts()))
            .map_err(|e| failed(&e.into()))?;
        Ok(work.campaign().table())
    }

    /// Remove all rows from the folder.
    fn clear(&self, py: Python) -> PyResult<()> {
        let work = self.work(py)?;
        work.campaign().clear().map_err(|e| failed(&e.into()))
    }

    fn __repr__(&self) -> String {
        format!("StudyPlan({:?}, runs={}, digest={:.8}…)", self.study, self.runs, self.digest)
    }
}

/// A table of a study from its file.
#[pyfunction]
pub fn read_study_table(py: Python, path: PathBuf) -> PyResult<Table> {
    let read = py.detach(|| Reader::open(&path).and_then(|reader| reader.table()));
    let read = read.map_err(|e| errors::data_error(py, format!("{}: {e}", path.display())))?;
    Ok(table(&path, &read))
}

fn table(path: &Path, read: &campaign::Table) -> Table {
    let mut table = Table::new(&path.display().to_string());
    for (c, heading) in read.headings.iter().enumerate() {
        let cells = read.rows.iter().map(|row| &row[c]);
        let series = match heading.kind {
            Kind::Float => Series::MaybeFloat(cells.map(Value::number).collect()),
            Kind::Integer => {
                Series::Integer(cells.map(|v| if let Value::Integer(x) = v { Some(*x) } else { None }).collect())
            }
            Kind::Text => {
                Series::Text(cells.map(|v| if let Value::Text(x) = v { Some(x.clone()) } else { None }).collect())
            }
            Kind::Flag => Series::Flag(cells.map(|v| if let Value::Flag(x) = v { Some(*x) } else { None }).collect()),
        };
        table.push(&heading.name, &heading.unit, series);
    }
    table
}
