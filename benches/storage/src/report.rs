//! The figures as a table and as CSV.

use std::fmt::Write;

use crate::measure::{Figures, quantile};

/// What was stored, and what each engine made of it.
pub struct Report {
    pub file_bytes: u64,
    pub roots_and_tables: u64,
    /// Bytes of all blocks.
    pub payload: u64,
    pub blocks: u64,
    pub valid_samples: u64,
    /// Along a diamond's side.
    pub cells: u32,
    pub engines: Vec<Figures>,
}

const COLUMNS: [&str; 13] = [
    "engine",
    "bytes",
    "over payload %",
    "open us",
    "first touch ns",
    "get p50 ns",
    "get p99 ns",
    "get p50 ns, 2 threads",
    "Mget/s",
    "2 threads / 1",
    "cold p50 us",
    "cold p99 us",
    "scan GB/s",
];

impl Report {
    fn rows(&self) -> Vec<Vec<String>> {
        self.engines
            .iter()
            .map(|figures| row(figures, self.payload))
            .collect()
    }

    /// For people, in Markdown.
    pub fn table(&self) -> String {
        let mut text = String::new();
        let bits = 8.0 * self.file_bytes as f64 / self.valid_samples as f64;
        _ = writeln!(
            text,
            "{} blocks of {} cells a side, {} bytes ({:.0} each); {} of roots and tables; the file {bits:.3} bits per sample\n",
            self.blocks,
            self.cells,
            self.payload,
            self.payload as f64 / self.blocks as f64,
            self.roots_and_tables,
        );
        _ = writeln!(text, "| {} |", COLUMNS.join(" | "));
        _ = writeln!(text, "|{}", "---|".repeat(COLUMNS.len()));
        for row in self.rows() {
            _ = writeln!(text, "| {} |", row.join(" | "));
        }
        text
    }

    /// For programs.
    pub fn csv(&self) -> String {
        let names = COLUMNS.map(|name| name.replace(", ", " "));
        let mut text = format!("blocks,payload,{}\n", names.join(","));
        for row in self.rows() {
            let row = row.join(",").replace("skipped", "");
            _ = writeln!(text, "{},{},{row}", self.blocks, self.payload);
        }
        text
    }
}

fn row(figures: &Figures, payload: u64) -> Vec<String> {
    let of = |numbers: &[f64], share: f64| quantile(&mut numbers.to_vec(), share);
    let cold = |share: f64| match figures.cold.is_empty() {
        true => "skipped".to_owned(),
        false => format!("{:.0}", of(&figures.cold, share) / 1e3),
    };
    // What others do on the machine only ever slows a round down.
    let [one, two] = [0, 1].map(|threads| of(&figures.rates[threads], 1.0));
    vec![
        figures.name.to_owned(),
        figures.bytes.to_string(),
        format!(
            "{:.2}",
            100.0 * (figures.bytes as f64 / payload as f64 - 1.0)
        ),
        format!("{:.0}", of(&figures.open, 0.5) / 1e3),
        format!("{:.0}", of(&figures.first_touch, 0.5)),
        format!("{:.1}", of(&figures.gets[0], 0.5)),
        format!("{:.0}", of(&figures.single, 0.99)),
        format!("{:.1}", of(&figures.gets[1], 0.5)),
        format!("{:.2}", one / 1e6),
        format!("{:.2}", two / one),
        cold(0.5),
        cold(0.99),
        format!("{:.2}", of(&figures.scans, 1.0) / 1e9),
    ]
}
