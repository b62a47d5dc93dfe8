//! The extension module of the Python package: the crate `arm` for arrays.
#![allow(non_snake_case)]

mod arm;
mod controller;
mod floats;
mod law;
mod reference;
mod trial;

use numpy::{PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::{Arc, Mutex, PoisonError};

#[pymodule]
mod _armplane {
    #[pymodule_export]
    use crate::arm::{Arm, Posture, Singularity, solids};
    #[pymodule_export]
    use crate::law::{Law, LawState};
    #[pymodule_export]
    use crate::reference::Reference;
    #[pymodule_export]
    use crate::trial::{
        check_scenario, draw_lines, law_names, orthogonal_bar_deg, random_twists, run_trial,
        scenario_arm, trace_trial,
    };
    use pyo3::prelude::*;

    /// An embedded interpreter may have no path.
    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        let path = module.py().import("sys")?.getattr("executable")?;
        let path = path.extract::<Option<String>>()?.unwrap_or_default();
        if !path.is_empty() {
            session::Python::is_host(path);
        }
        Ok(())
    }
}

/// A `ValueError` with any error's sentence.
fn refused(error: impl ToString) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// An argument as an array of doubles, copied only where it is not one already: `rows` (one of `None`: any number) of one of the `shapes`.
///
/// # Errors
/// `ValueError` with the argument's name, its shape and the expected ones.
fn numbers<'py>(
    name: &str,
    given: &Bound<'py, PyAny>,
    rows: &[Option<usize>],
    shapes: &[&[usize]],
) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    let array = match given.cast::<PyArrayDyn<f64>>() {
        Ok(array) if array.is_c_contiguous() => array.clone(),
        _ => {
            let numpy = given.py().import("numpy")?;
            let array = numpy.call_method1("asarray", (given, "f8", "C"));
            let array =
                array.map_err(|error| refused(format!("{name}: {}", error.value(given.py()))))?;
            array.cast_into()?
        }
    };
    let shape = array.shape();
    let fits = |one: &&[usize]| {
        shape.len() == rows.len() + one.len()
            && shape.ends_with(one)
            && (rows.iter().zip(shape)).all(|(rows, given)| rows.is_none_or(|rows| rows == *given))
    };
    if shapes.iter().any(fits) {
        return Ok(array.try_readonly()?);
    }
    let text = |sizes: Vec<String>| match &sizes[..] {
        [one] => format!("({one},)"),
        more => format!("({})", more.join(", ")),
    };
    let size = |rows: &Option<usize>| rows.map_or("N".to_owned(), |rows| rows.to_string());
    let expected = shapes.iter().map(|one| {
        let sizes = one.iter().map(usize::to_string);
        text(rows.iter().map(size).chain(sizes).collect())
    });
    let expected = expected.collect::<Vec<_>>().join(" or ");
    let given = text(shape.iter().map(usize::to_string).collect());
    Err(refused(format!(
        "{name} has the shape {given}; it must be {expected}"
    )))
}

/// Works on parts of `rows` on all cores; `work` gets the index of a part's first row.
fn in_parts<T: Send>(rows: &mut [T], work: impl Fn(usize, &mut [T]) + Sync) {
    /// Rows that a thread takes at a time: twice as many are worth a second one.
    const PART: usize = 16;
    let parts = || rows.len() / PART;
    let Some(pool) = (parts() >= 2).then(threads).flatten() else {
        return work(0, rows);
    };
    pool.install(|| {
        let parts = rows.par_chunks_mut(PART).enumerate();
        parts.for_each(|(i, part)| work(i * PART, part));
    });
}

/// The threads of this process, one for each core, started by the first call; `None` where there are none to be had.
fn threads() -> Option<Arc<ThreadPool>> {
    static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);
    let (process, mut pool) = (
        std::process::id(),
        POOL.lock().unwrap_or_else(PoisonError::into_inner),
    );
    if pool.as_ref().is_none_or(|(of, _)| *of != process) {
        let made = ThreadPoolBuilder::new().thread_name(|i| format!("armplane-rows-{i}"));
        let made = made.build().ok().map(|made| (process, Arc::new(made)));
        // A forked child has none of its parent's threads to end.
        std::mem::forget(std::mem::replace(&mut *pool, made));
    }
    pool.as_ref().map(|(_, pool)| Arc::clone(pool))
}
