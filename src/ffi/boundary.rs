//! What every function of the boundary shares: the panic barrier and the checks of pointers.

use std::any::Any;
use std::borrow::Cow;
use std::ffi::{CStr, c_char};
use std::mem::MaybeUninit;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

use super::status::{kmb_status, set_last_error};
use crate::Error;

/// Why a function did not do what it was asked.
pub(super) struct Failure {
    pub(super) status: kmb_status,
    pub(super) message: Cow<'static, str>,
}

/// What a body gives to the barrier.
pub(super) type Outcome = Result<(), Failure>;

impl Failure {
    pub(super) fn new(status: kmb_status, message: impl Into<Cow<'static, str>>) -> Failure {
        Failure {
            status,
            message: message.into(),
        }
    }

    pub(super) fn argument(message: impl Into<Cow<'static, str>>) -> Failure {
        Failure::new(kmb_status::KMB_INVALID_ARGUMENT, message)
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Failure {
        let status = match error {
            Error::Io { .. } => kmb_status::KMB_IO,
            Error::Input { .. } => kmb_status::KMB_INPUT,
            Error::Damaged { .. } | Error::Missing { .. } => kmb_status::KMB_DAMAGED,
            Error::Version { .. } => kmb_status::KMB_UNSUPPORTED_VERSION,
            Error::Argument(_) => kmb_status::KMB_INVALID_ARGUMENT,
            Error::Cancelled => kmb_status::KMB_CANCELLED,
        };
        Failure::new(status, error.to_string())
    }
}

/// An object that C holds by an opaque pointer.
pub(super) trait Handle {
    /// Its name in C.
    const NAME: &'static str;

    /// Set when a panic was caught while it was in use.
    fn broken(&self) -> &AtomicBool;
}

/// A C struct whose first member is `uint32_t struct_size`.
///
/// # Safety
///
/// The type is `repr(C)`, begins with that member, and any bits are a valid value of it.
pub(super) unsafe trait SizedStruct: Copy {
    /// Its name in C.
    const NAME: &'static str;
}

/// Wraps the body of a function: nothing unwinds out of it, and its outcome becomes a status and
/// this thread's message. `shared` and `exclusive` name a handle, which is checked before the body
/// runs, is seen by it as a reference, and is broken by a panic.
macro_rules! boundary {
    ($body:block) => {
        $crate::ffi::boundary::run(|| -> $crate::ffi::boundary::Outcome { $body })
    };
    (shared $handle:ident: $type:ty, $body:block) => {{
        let body = |$handle: &$type| -> $crate::ffi::boundary::Outcome { $body };
        // SAFETY: the caller passes NULL or a handle that lives, as the header asks.
        unsafe { $crate::ffi::boundary::run_shared($handle, body) }
    }};
    (exclusive $handle:ident: $type:ty, $body:block) => {{
        let body = |$handle: &mut $type| -> $crate::ffi::boundary::Outcome { $body };
        // SAFETY: the caller passes NULL or a handle that lives and that no other call uses, as the
        // header asks.
        unsafe { $crate::ffi::boundary::run_exclusive($handle, body) }
    }};
}
pub(super) use boundary;

/// Runs a body that uses no handle.
pub(super) fn run(body: impl FnOnce() -> Outcome) -> kmb_status {
    match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(())) => kmb_status::KMB_OK,
        Ok(Err(failure)) => {
            set_last_error(&failure.message);
            failure.status
        }
        Err(payload) => {
            set_last_error(&format!("internal error: {}", panic_message(&*payload)));
            kmb_status::KMB_PANIC
        }
    }
}

/// Runs a body on a shared handle.
///
/// # Safety
///
/// `handle` is NULL, misaligned, or points to a `T` that lives until the body ends.
pub(super) unsafe fn run_shared<T: Handle>(
    handle: *const T,
    body: impl FnOnce(&T) -> Outcome,
) -> kmb_status {
    // SAFETY: as the caller promises.
    let handle = unsafe { required(handle, T::NAME) };
    match handle {
        Ok(handle) => break_on_panic(handle.broken(), run(|| usable(handle).and_then(body))),
        Err(failure) => run(|| Err(failure)),
    }
}

/// Runs a body on an exclusive handle.
///
/// # Safety
///
/// `handle` is NULL, misaligned, or points to a `T` that lives, and that nothing else uses, until
/// the body ends.
pub(super) unsafe fn run_exclusive<T: Handle>(
    handle: *mut T,
    body: impl FnOnce(&mut T) -> Outcome,
) -> kmb_status {
    // SAFETY: as the caller promises.
    if let Err(failure) = unsafe { required(handle.cast_const(), T::NAME) } {
        return run(|| Err(failure));
    }
    let status = run(|| {
        // SAFETY: checked above; exclusive as the caller promises.
        let handle = unsafe { &mut *handle };
        usable(handle)?;
        body(handle)
    });
    // SAFETY: checked above, and the exclusive reference has ended.
    break_on_panic(unsafe { &*handle }.broken(), status)
}

pub(super) fn usable<T: Handle>(handle: &T) -> Result<&T, Failure> {
    if handle.broken().load(Ordering::Relaxed) {
        let message = format!("the {} is unusable after an internal error", T::NAME);
        return Err(Failure::new(kmb_status::KMB_PANIC, message));
    }
    Ok(handle)
}

fn break_on_panic(broken: &AtomicBool, status: kmb_status) -> kmb_status {
    if status == kmb_status::KMB_PANIC {
        broken.store(true, Ordering::Relaxed);
    }
    status
}

fn panic_message(payload: &(dyn Any + Send)) -> &str {
    let text = payload.downcast_ref::<&str>().copied();
    text.or_else(|| payload.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("no message")
}

fn check_pointer<T>(pointer: *const T, name: &str) -> Outcome {
    if pointer.is_null() {
        return Err(Failure::argument(format!("{name} is NULL")));
    }
    if !pointer.is_aligned() {
        let alignment = align_of::<T>();
        return Err(Failure::argument(format!(
            "{name} is not aligned to {alignment} bytes"
        )));
    }
    Ok(())
}

/// What an argument points to.
///
/// # Safety
///
/// `pointer` is NULL, misaligned, or points to a valid `T` that lives and does not change during
/// `'a`.
pub(super) unsafe fn required<'a, T>(pointer: *const T, name: &str) -> Result<&'a T, Failure> {
    check_pointer(pointer, name)?;
    // SAFETY: neither NULL nor misaligned; the rest is the caller's promise.
    Ok(unsafe { &*pointer })
}

/// The place of a result.
///
/// # Safety
///
/// `pointer` is NULL, misaligned, or points to memory for a `T` that nothing else uses during `'a`.
pub(super) unsafe fn output<'a, T>(
    pointer: *mut T,
    name: &str,
) -> Result<&'a mut MaybeUninit<T>, Failure> {
    check_pointer(pointer, name)?;
    // SAFETY: neither NULL nor misaligned; the rest is the caller's promise.
    Ok(unsafe { &mut *pointer.cast::<MaybeUninit<T>>() })
}

/// `count` values at `pointer`, which may be anything when `count` is 0.
///
/// # Safety
///
/// `pointer` is NULL, misaligned, or points to `count` valid values that live and do not change
/// during `'a`.
pub(super) unsafe fn array<'a, T>(
    pointer: *const T,
    count: usize,
    name: &str,
) -> Result<&'a [T], Failure> {
    if count == 0 {
        return Ok(&[]);
    }
    check_array(pointer, count, name)?;
    // SAFETY: neither NULL nor misaligned nor longer than memory; the rest is the caller's promise.
    Ok(unsafe { std::slice::from_raw_parts(pointer, count) })
}

/// The place of `count` results, all of which hold a valid value already.
///
/// # Safety
///
/// As [`array`]'s, and nothing else uses the memory during `'a`.
pub(super) unsafe fn output_array<'a, T>(
    pointer: *mut T,
    count: usize,
    name: &str,
) -> Result<&'a mut [T], Failure> {
    check_array(pointer, count, name)?;
    // SAFETY: neither NULL nor misaligned nor longer than memory; the rest is the caller's promise.
    Ok(unsafe { std::slice::from_raw_parts_mut(pointer, count) })
}

fn check_array<T>(pointer: *const T, count: usize, name: &str) -> Outcome {
    check_pointer(pointer, name)?;
    match count.checked_mul(size_of::<T>()) {
        Some(bytes) if bytes <= isize::MAX as usize => Ok(()),
        _ => Err(Failure::argument(format!(
            "{name} cannot hold {count} values"
        ))),
    }
}

/// The struct that an argument points to, once its size is known to be right.
///
/// # Safety
///
/// `pointer` is NULL, misaligned, or points to a struct that is as long as its first member says.
pub(super) unsafe fn input_struct<T: SizedStruct>(pointer: *const T) -> Result<T, Failure> {
    check_pointer(pointer, T::NAME)?;
    // SAFETY: every such struct begins with its size; the rest follows only if it is there.
    let size = unsafe { pointer.cast::<u32>().read() };
    if usize::try_from(size) != Ok(size_of::<T>()) {
        let (name, right) = (T::NAME, size_of::<T>());
        return Err(Failure::new(
            kmb_status::KMB_INVALID_STRUCT_SIZE,
            format!("struct_size of {name} is {size} where {right} is right"),
        ));
    }
    // SAFETY: the memory is as long as the struct, whose bits are a value whatever they are.
    Ok(unsafe { pointer.read() })
}

/// The place of a result that is a struct; its size was set by the caller.
///
/// # Safety
///
/// Those of [`input_struct`] and of [`output`].
pub(super) unsafe fn output_struct<'a, T: SizedStruct>(
    pointer: *mut T,
) -> Result<&'a mut MaybeUninit<T>, Failure> {
    check_pointer(pointer, T::NAME)?;
    // SAFETY: every such struct begins with its size; nothing else of it is read.
    let size = unsafe { pointer.cast::<u32>().read() };
    if usize::try_from(size) != Ok(size_of::<T>()) {
        let (name, right) = (T::NAME, size_of::<T>());
        return Err(Failure::new(
            kmb_status::KMB_INVALID_STRUCT_SIZE,
            format!("struct_size of {name} is {size} where {right} is right"),
        ));
    }
    // SAFETY: as the caller promises.
    unsafe { output(pointer, T::NAME) }
}

/// A string argument.
///
/// # Safety
///
/// `pointer` is NULL or points to bytes that end with a 0 and do not change during `'a`.
pub(super) unsafe fn text<'a>(pointer: *const c_char, name: &str) -> Result<&'a str, Failure> {
    check_pointer(pointer, name)?;
    // SAFETY: not NULL; the rest is the caller's promise.
    let bytes = unsafe { CStr::from_ptr(pointer) };
    bytes
        .to_str()
        .map_err(|_| Failure::argument(format!("{name} is not UTF-8")))
}

/// A path argument: bytes as the system has them, or UTF-8 where it has none.
///
/// # Safety
///
/// That of [`text`].
pub(super) unsafe fn path(pointer: *const c_char) -> Result<PathBuf, Failure> {
    #[cfg(unix)]
    {
        use std::os::unix::ffi::OsStrExt;

        check_pointer(pointer, "path")?;
        // SAFETY: not NULL; the rest is the caller's promise.
        let bytes = unsafe { CStr::from_ptr(pointer) }.to_bytes();
        Ok(PathBuf::from(std::ffi::OsStr::from_bytes(bytes)))
    }
    #[cfg(not(unix))]
    {
        // SAFETY: as the caller promises.
        unsafe { text(pointer, "path") }.map(PathBuf::from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Lamp {
        broken: AtomicBool,
    }

    impl Handle for Lamp {
        const NAME: &'static str = "lamp";

        fn broken(&self) -> &AtomicBool {
            &self.broken
        }
    }

    fn panics() -> Outcome {
        panic!("filament")
    }

    fn lamp() -> Lamp {
        Lamp {
            broken: AtomicBool::new(false),
        }
    }

    #[test]
    fn a_panic_without_a_handle_becomes_a_status() {
        assert_eq!(boundary!({ panics() }), kmb_status::KMB_PANIC);
    }

    #[test]
    fn a_panic_breaks_a_shared_handle() {
        let own = lamp();
        let handle = &raw const own;
        assert_eq!(
            boundary!(shared handle: Lamp, { let _ = handle; Ok(()) }),
            kmb_status::KMB_OK
        );
        assert_eq!(
            boundary!(shared handle: Lamp, { let _ = handle; panics() }),
            kmb_status::KMB_PANIC
        );
        assert_eq!(
            boundary!(shared handle: Lamp, { let _ = handle; Ok(()) }),
            kmb_status::KMB_PANIC
        );
    }

    #[test]
    fn a_panic_breaks_an_exclusive_handle() {
        let mut own = lamp();
        let handle = &raw mut own;
        assert_eq!(
            boundary!(exclusive handle: Lamp, { let _ = handle; Ok(()) }),
            kmb_status::KMB_OK
        );
        assert_eq!(
            boundary!(exclusive handle: Lamp, { let _ = handle; panics() }),
            kmb_status::KMB_PANIC
        );
        assert_eq!(
            boundary!(exclusive handle: Lamp, { let _ = handle; Ok(()) }),
            kmb_status::KMB_PANIC
        );
    }
}
