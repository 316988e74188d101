//! [`StudyPlan`]: a study or an exam cut into chunks, each a pure function of what is studied and of its number.

use std::path::{Path, PathBuf};

use deltatwin_io::outside::Access;
use deltatwin_io::study;
use deltatwin_study::campaign::parquet::Reader;
use deltatwin_study::campaign::{self, Campaign, CampaignError, Chunk, Held, Kind, Value, Watch};
use deltatwin_study::conduct::{Conduct, ConductError};
use deltatwin_validation::exam::Exam;
use deltatwin_validation::exam::campaign::hideable;
use deltatwin_validation::exam::experiment::Experiments;
use deltatwin_validation::exam::plan::Plan;
use deltatwin_validation::exam::{MotionKind, Noise, Size};
use pyo3::exceptions::{PyOSError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;

use crate::errors;
use crate::interrupt::{Bar, Task, run};
use crate::model::Model;
use crate::table::{Series, Table};

/// A study or an exam with the folder of its rows.
#[pyclass(frozen, module = "deltatwin")]
pub struct StudyPlan {
    subject: Subject,
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

/// What is studied: what a file says, or the diagnosis with a model.
enum Subject {
    Study(PathBuf),
    Exam { model: Box<deltatwin::model::Model>, plan: Box<Plan>, fast_null: u64, anew: bool },
}

/// What the rows are made of: runs of a scenario, experiments that hide effects in a model, or campaigns of an exam.
enum Work {
    Runs(Box<Conduct>),
    Experiments(Box<Experiments>),
    Exam(Box<Exam>),
}

impl Work {
    fn new(subject: &Subject, folder: &Path) -> miette::Result<Self> {
        let file = match subject {
            Subject::Study(file) => file,
            Subject::Exam { model, plan, fast_null, anew } => {
                let exam = Exam::new((**model).clone(), (**plan).clone(), *fast_null, folder)?;
                return Ok(Self::Exam(exam.judging(*anew).into()));
            }
        };
        let study = study::read(file, Access::with(deltatwin_cell::mesh::read))?;
        Ok(match study.experiment {
            None => Self::Runs(Conduct::new(study, folder)?.into()),
            Some(_) => Self::Experiments(Experiments::new(study, folder)?.into()),
        })
    }

    fn campaign(&self) -> &Campaign {
        match self {
            Self::Runs(conduct) => &conduct.campaign,
            Self::Experiments(experiments) => &experiments.campaign,
            Self::Exam(exam) => &exam.rows,
        }
    }

    fn runs(&self) -> u64 {
        match self {
            Self::Runs(conduct) => conduct.runs(),
            Self::Experiments(experiments) => experiments.runs(),
            Self::Exam(exam) => exam.runs(),
        }
    }

    fn is_search(&self) -> bool {
        matches!(self, Self::Runs(conduct) if conduct.is_search())
    }

    fn chunk(&self, chunk: Chunk, watch: &dyn Watch) -> Result<(), ConductError> {
        match self {
            Self::Runs(conduct) => conduct.chunk(chunk, watch),
            Self::Experiments(experiments) => Ok(experiments.chunk(chunk, watch)?),
            // What is left out has a row that says so.
            Self::Exam(exam) => Ok(exam.chunk(chunk, watch, &|_| {})?),
        }
    }
}

impl StudyPlan {
    fn of(py: Python, subject: Subject, folder: PathBuf) -> PyResult<Self> {
        let work = Work::new(&subject, &folder).map_err(|e| errors::report(py, &e))?;
        let (runs, is_search) = (work.runs(), work.is_search());
        let (digest, build) = (work.campaign().digest.hex(), work.campaign().build.clone());
        Ok(Self { subject, folder, runs, digest, build, is_search })
    }

    fn work(&self, py: Python) -> PyResult<Work> {
        Work::new(&self.subject, &self.folder).map_err(|e| errors::report(py, &e))
    }
}

/// The items of `all` called by `names`, which an argument `what` gives.
fn chosen<T: Copy>(what: &str, names: &[String], all: &[T], name: impl Fn(T) -> &'static str) -> PyResult<Vec<T>> {
    let one = |wanted: &String| {
        all.iter().copied().find(|item| name(*item) == wanted).ok_or_else(|| {
            let known: Vec<&str> = all.iter().map(|item| name(*item)).collect();
            PyValueError::new_err(format!("{what} is {wanted:?}; expected one of {}", known.join(", ")))
        })
    };
    names.iter().map(one).collect()
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
        Self::of(py, Subject::Study(study), folder)
    }

    /// An exam of the diagnosis; arguments and errors as for ``deltatwin.exam``. ``force`` judges again what has an answer.
    #[staticmethod]
    #[pyo3(signature = (model, folder, *, effects = None, sizes = vec!["medium".into()], seeds = 1, pairs = 0, outside = 0,
                        null = 1, fast_null = 0, noise = vec!["white".into()], motion = "wideband".into(),
                        strut_sensors = true, payloads = true, duration = 20.0, seed = 1, force = false))]
    #[expect(clippy::too_many_arguments, reason = "the keywords of the function")]
    fn of_exam(
        py: Python,
        model: &Model,
        folder: PathBuf,
        effects: Option<Vec<String>>,
        sizes: Vec<String>,
        seeds: u64,
        pairs: u64,
        outside: u64,
        null: u64,
        fast_null: u64,
        noise: Vec<String>,
        motion: String,
        strut_sensors: bool,
        payloads: bool,
        duration: f64,
        seed: u64,
        force: bool,
    ) -> PyResult<Self> {
        let path = model.inner.path.clone().unwrap_or_else(|| PathBuf::from("model.toml"));
        // The digest covers the text, and a model that was changed since it was read has another one.
        let parsed = deltatwin_io::model::parse(&model.text(py)?, &path).map_err(|e| errors::report(py, &e))?;
        let all = || hideable(&parsed).iter().map(|e| e.name().to_string()).collect();
        let plan = Plan {
            effects: effects.unwrap_or_else(all),
            sizes: chosen("sizes", &sizes, &Size::ALL, Size::name)?,
            seeds,
            pairs,
            outside,
            null,
            noise: chosen("noise", &noise, &Noise::ALL, Noise::name)?,
            motion: chosen("motion", &[motion], &MotionKind::ALL, MotionKind::name)?[0],
            strut_sensors,
            payloads,
            duration,
            seed,
        };
        Self::of(py, Subject::Exam { model: parsed.into(), plan: plan.into(), fast_null, anew: force }, folder)
    }

    #[getter]
    fn study(&self) -> Option<PathBuf> {
        match &self.subject {
            Subject::Study(file) => Some(file.clone()),
            Subject::Exam { .. } => None,
        }
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

    /// Take the folder for this study. Raises ``ValueError`` if it belongs to another one.
    fn claim(&self, py: Python) -> PyResult<()> {
        let work = self.work(py)?;
        work.campaign().claim().map_err(|e| failed(&e.into()))
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
        let of = match &self.subject {
            Subject::Study(file) => format!("{file:?}"),
            Subject::Exam { model, .. } => format!("exam of {:?}", model.name),
        };
        format!("StudyPlan({of}, runs={}, digest={:.8}…)", self.runs, self.digest)
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
