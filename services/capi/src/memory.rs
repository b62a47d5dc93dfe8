//! The caller's memory: pointers that may be null, as what they point to.

use std::ffi::{CStr, c_char};
use std::fmt::Display;
use std::io::Write;
use std::mem::MaybeUninit;

use crate::armplane_status::{self, ARMPLANE_ERROR_NULL, ARMPLANE_OK};

/// The numbers at a pointer; `None` for null.
///
/// # Safety
/// It is null or points to `count` numbers, which nobody changes for `'a`.
pub(crate) unsafe fn numbers<'a>(at: *const f64, count: usize) -> Option<&'a [f64]> {
    // SAFETY: the caller's.
    (!at.is_null()).then(|| unsafe { std::slice::from_raw_parts(at, count) })
}

/// Values to be written; `None` for null.
///
/// # Safety
/// It is null or points to `count` values, which nobody else uses for `'a`.
pub(crate) unsafe fn whole<'a, T>(at: *mut T, count: usize) -> Option<&'a mut [T]> {
    // SAFETY: the caller's.
    (!at.is_null()).then(|| unsafe { std::slice::from_raw_parts_mut(at, count) })
}

/// Room for values, with anything in it; `None` for null.
///
/// # Safety
/// It is null or points to room for `count` values, which nobody else uses for `'a`.
pub(crate) unsafe fn room<'a, T>(at: *mut T, count: usize) -> Option<&'a mut [MaybeUninit<T>]> {
    // SAFETY: the caller's.
    unsafe { whole(at.cast(), count) }
}

/// Writes a value.
///
/// # Safety
/// `to` is null or room for it.
pub(crate) unsafe fn give<T>(to: *mut T, value: T) -> Result<armplane_status, armplane_status> {
    if to.is_null() {
        return Err(ARMPLANE_ERROR_NULL);
    }
    // SAFETY: not null, so room for it.
    unsafe { to.write(value) };
    Ok(ARMPLANE_OK)
}

/// The text at a pointer; `None` for null.
///
/// # Errors
/// With the argument's name, for bytes that are no UTF-8.
///
/// # Safety
/// It is null or points to a text that ends with a zero byte, which nobody changes for `'a`.
pub(crate) unsafe fn text<'a>(name: &str, at: *const c_char) -> Result<Option<&'a str>, String> {
    if at.is_null() {
        return Ok(None);
    }
    // SAFETY: the caller's.
    let text = unsafe { CStr::from_ptr(at) }.to_str();
    text.map(Some)
        .map_err(|_| format!("{name} is not UTF-8: give it in UTF-8"))
}

/// Words as C has them, cut where they are longer. No allocation.
pub(crate) fn words<const N: usize>(text: impl Display) -> [c_char; N] {
    let mut buffer = [0; N];
    put(&mut buffer, text);
    buffer.map(|byte| byte as c_char)
}

/// The same into a buffer; its last byte is zero.
pub(crate) fn put(buffer: &mut [u8], text: impl Display) {
    buffer.fill(0);
    if let Some((_, mut room)) = buffer.split_last_mut() {
        // An error says that the text is cut here.
        let _ = write!(room, "{text}");
    }
}
