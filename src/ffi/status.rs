//! Version, errors and messages.

use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char, c_void};

use super::boundary::boundary;
use crate::{LogLevel, set_log_callback};

/// Number of this interface: it grows when a program that was compiled against an older header
/// would no longer work.
pub const KMB_ABI_VERSION: u32 = 0;

/// What a function answers. Except where a function says otherwise, results are written only with
/// KMB_OK.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum kmb_status {
    /// Done.
    KMB_OK = 0,
    /// A pointer is NULL or misaligned, a string is not UTF-8, or a value is outside what the
    /// function accepts.
    KMB_INVALID_ARGUMENT = 1,
    /// The struct_size of a struct is not that of this library's struct.
    KMB_INVALID_STRUCT_SIZE = 2,
    /// The system refused an operation on a file.
    KMB_IO = 3,
    /// The rows of a raster cannot be used, or the rows callback failed.
    KMB_INPUT = 4,
    /// A repository's bytes are not what the format says.
    KMB_DAMAGED = 5,
    /// A repository asks for another version of this library.
    KMB_UNSUPPORTED_VERSION = 6,
    /// The progress callback asked to stop.
    KMB_CANCELLED = 7,
    /// The position lies outside the raster or in a void.
    KMB_OUTSIDE = 8,
    /// The budget does not even allow the coarsest patches; they are given all the same.
    KMB_BUDGET_TOO_SMALL = 9,
    /// There is nothing under this index or key.
    KMB_NOT_FOUND = 10,
    /// An internal error was caught. The handle answers nothing else from now on; destroy it.
    KMB_PANIC = 11,
    /// The caller's memory does not hold the result.
    KMB_BUFFER_TOO_SMALL = 12,
}

/// How much a message matters.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum kmb_log_level {
    /// Progress, and choices that the library made.
    KMB_LOG_INFO = 0,
    /// Something was odd in the input, and how it was read.
    KMB_LOG_WARNING = 1,
}

/// Gets one message, a line without its end. `level` is a kmb_log_level. It may come from any
/// thread, and from several at once; `message` lives until the callback returns. The callback must
/// not call kmb_set_log_callback.
pub type kmb_log_callback =
    Option<unsafe extern "C" fn(user: *mut c_void, level: u32, message: *const c_char)>;

const NAMES: [&CStr; 13] = [
    c"KMB_OK",
    c"KMB_INVALID_ARGUMENT",
    c"KMB_INVALID_STRUCT_SIZE",
    c"KMB_IO",
    c"KMB_INPUT",
    c"KMB_DAMAGED",
    c"KMB_UNSUPPORTED_VERSION",
    c"KMB_CANCELLED",
    c"KMB_OUTSIDE",
    c"KMB_BUDGET_TOO_SMALL",
    c"KMB_NOT_FOUND",
    c"KMB_PANIC",
    c"KMB_BUFFER_TOO_SMALL",
];

thread_local! {
    /// With its final NUL, if there was one.
    static LAST_ERROR: RefCell<Vec<u8>> = RefCell::default();
}

/// Keeps this thread's message. A thread that is ending keeps none.
pub(super) fn set_last_error(message: &str) {
    let _ = LAST_ERROR.try_with(|slot| {
        // In the memory of the last one, as rays that meet nothing come by the million.
        let mut text = slot.borrow_mut();
        text.clear();
        text.extend_from_slice(message.as_bytes());
        text.iter_mut()
            .filter(|byte| **byte == 0)
            .for_each(|byte| *byte = b' ');
        text.push(0);
    });
}

/// The version of the library as text, "major.minor.patch". The string is static.
///
/// May be called from any thread at any time.
#[unsafe(no_mangle)]
pub extern "C" fn kmb_version() -> *const c_char {
    const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), "\0");
    VERSION.as_ptr().cast()
}

/// The KMB_ABI_VERSION of the library that runs, which may differ from that of the header.
///
/// May be called from any thread at any time.
#[unsafe(no_mangle)]
pub extern "C" fn kmb_abi_version() -> u32 {
    KMB_ABI_VERSION
}

/// The name of a status, such as "KMB_DAMAGED", or "unknown status" for any other number. The
/// string is static.
///
/// May be called from any thread at any time.
#[unsafe(no_mangle)]
pub extern "C" fn kmb_status_name(status: i32) -> *const c_char {
    let name = usize::try_from(status)
        .ok()
        .and_then(|index| NAMES.get(index));
    name.map_or(c"unknown status", |name| name).as_ptr()
}

/// The message of the latest call on this thread that did not answer KMB_OK: one line of UTF-8 with
/// the place (file, row and column, or argument) and the cause; empty if there was none. The string
/// belongs to the library and lives until the next such call on this thread, or the thread's end.
///
/// May be called from any thread at any time.
#[unsafe(no_mangle)]
pub extern "C" fn kmb_last_error() -> *const c_char {
    let message = LAST_ERROR.try_with(|slot| {
        let text = slot.try_borrow().ok()?;
        (!text.is_empty()).then(|| text.as_ptr().cast())
    });
    message.ok().flatten().unwrap_or(c"".as_ptr())
}

struct LogUser(*mut c_void);
// SAFETY: the header asks for a callback, and so a `user`, that any thread may use.
unsafe impl Send for LogUser {}
// SAFETY: as above.
unsafe impl Sync for LogUser {}

impl LogUser {
    fn pointer(&self) -> *mut c_void {
        self.0
    }
}

/// Sends all messages of the library to `callback` with `user`; NULL stops them. The library itself
/// prints nothing. When this returns, the former callback runs nowhere and is called no more.
///
/// May be called from any thread, but not from within the callback.
///
/// Returns KMB_OK, KMB_PANIC.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kmb_set_log_callback(
    callback: kmb_log_callback,
    user: *mut c_void,
) -> kmb_status {
    boundary!({
        let user = LogUser(user);
        set_log_callback(callback.map(|callback| {
            let send = move |level: LogLevel, message: &str| {
                let message = CString::new(message.replace('\0', " ")).unwrap_or_default();
                // SAFETY: the caller gave a function that may be called so, with this `user`.
                unsafe { callback(user.pointer(), level as u32, message.as_ptr()) }
            };
            Box::new(send) as Box<dyn Fn(LogLevel, &str) + Send + Sync>
        }));
        Ok(())
    })
}
