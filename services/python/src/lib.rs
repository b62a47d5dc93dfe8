//! The extension module of the Python package: [`arm`] and [`law`] give Python the code of the processes `analyzer` and `controller`, message by message.
//!
//! No algebra and no state of its own: what a law remembers is in the two steps that it holds.
#![allow(non_snake_case)]

mod arm;
mod law;

use numpy::{PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

#[pymodule]
mod _armplane {
    #[pymodule_export]
    use crate::arm::{Arm, Posture, Singularity};
    #[pymodule_export]
    use crate::law::{Law, LawState};
}

/// A `ValueError` with any error's sentence.
fn refused(error: impl ToString) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// An argument as an array of doubles, rows one after another; copied only where it is not one already. `*` in an expected shape is any number.
///
/// # Errors
/// `ValueError` with the argument's name, its shape and the expected ones.
fn numbers<'py>(
    name: &str,
    given: &Bound<'py, PyAny>,
    expected: &[&[Option<usize>]],
) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    let array = match given.cast::<PyArrayDyn<f64>>() {
        Ok(array) if array.is_c_contiguous() => array.clone(),
        _ => {
            let numpy = given.py().import("numpy")?;
            numpy
                .call_method1("ascontiguousarray", (given, "f8"))?
                .cast_into()?
        }
    };
    let shape = array.shape();
    let fits = |expected: &&[Option<usize>]| {
        expected.len() == shape.len()
            && (expected.iter().zip(shape)).all(|(size, given)| size.is_none_or(|n| n == *given))
    };
    if expected.iter().any(|expected| fits(&expected)) {
        return Ok(array.try_readonly()?);
    }
    let text = |shape: Vec<String>| match &shape[..] {
        [one] => format!("({one},)"),
        more => format!("({})", more.join(", ")),
    };
    let given = text(shape.iter().map(ToString::to_string).collect());
    let sizes = |shape: &&[Option<usize>]| {
        let size = |size: &Option<usize>| size.map_or("N".to_owned(), |n| n.to_string());
        text(shape.iter().map(size).collect())
    };
    let expected: Vec<String> = expected.iter().map(sizes).collect();
    let expected = expected.join(" or ");
    Err(refused(format!(
        "{name} has the shape {given}; expected is {expected}"
    )))
}

/// Works on parts of `rows` on all cores; `work` gets the index of a part's first row.
fn in_parts<T: Send>(rows: &mut [T], work: impl Fn(usize, &mut [T]) + Sync) {
    /// Below this many rows a thread costs more than it saves.
    const LEAST: usize = 32;
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let size = rows.len().div_ceil(cores).max(LEAST);
    let work = &work;
    std::thread::scope(|scope| {
        let mut parts = rows.chunks_mut(size).enumerate();
        let first = parts.next();
        for (i, part) in parts {
            scope.spawn(move || work(i * size, part));
        }
        if let Some((_, part)) = first {
            work(0, part);
        }
    });
}
