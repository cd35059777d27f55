//! Tables of figures.

use std::path::Path;

use crate::Result;

/// Rows of equal length under column names.
pub struct Table {
    text: String,
}

impl Table {
    /// One without rows. Every row is also printed.
    pub fn new(columns: &str) -> Table {
        println!("{columns}");
        Table {
            text: format!("{columns}\n"),
        }
    }

    pub fn add(&mut self, row: &[String]) {
        let row = row.join(",");
        println!("{row}");
        self.text += &row;
        self.text.push('\n');
    }

    pub fn write(&self, path: &Path) -> Result<()> {
        Ok(std::fs::write(path, &self.text)?)
    }
}

/// Six significant digits.
pub fn number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let decimals = (5 - value.abs().log10().floor() as i32).clamp(0, 12);
    let text = format!("{value:.*}", decimals as usize);
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

/// What a share `q` of the values does not exceed. They are put in order; there is at least one.
pub fn quantile<T: Copy + PartialOrd>(values: &mut [T], q: f64) -> T {
    let place = ((values.len() as f64 * q).ceil() as usize).clamp(1, values.len()) - 1;
    let order = |a: &T, b: &T| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal);
    *values.select_nth_unstable_by(place, order).1
}
