//! A BlockMap as few bytes, without loss: errors of prediction by static tables in contexts (`docs/format.md`, Cities).

mod rows;
mod sections;
mod tables;

use self::rows::{Coder, LANES, NOWHERE, Places, Plane, Predictor, Row};
use self::sections::{Hints, PLANES};
use self::tables::{Model, NO_COUNTS, PlaneCounts};
use super::layout::BlockMap;
use crate::entropy::frequency::Frequencies;
use crate::entropy::rans;
use crate::entropy::token;
use crate::{Error, Result};

/// The form of the bytes that this library writes.
const FORM: u8 = 2;
/// Form, log2 of K, log2 of the slices, flags, four floats, the step of walls, and the lengths of model and symbols.
const HEADER_LENGTH: usize = 4 + 4 * 4 + 2 + 2 + 4;
const HAS_16_BITS: u8 = 1;
const HAS_ALL_COLUMNS: u8 = 2;
/// Most symbols of a row.
const LONGEST_ROW: usize = 256;

/// The bytes of a block, but for its place.
///
/// # Errors
///
/// [`Error::Argument`] for a block that [`decode`] would refuse.
pub fn encode(map: &BlockMap) -> Result<Vec<u8>> {
    check(map).map_err(Error::Argument)?;
    let hints = Hints {
        step: step(map),
        has_all_columns: !sections::is_rest_blank(map),
    };
    let mut recorder = Recorder::default();
    sections::walk(&mut recorder, &mut map.clone(), hints);
    let (model, symbols) = recorder.finish();
    let mut flags = 0;
    if map.low_heights.is_some() {
        flags |= HAS_16_BITS;
    }
    if hints.has_all_columns {
        flags |= HAS_ALL_COLUMNS;
    }
    let logs = [map.side_texels, map.slices].map(|count| count.ilog2() as u8);
    let mut bytes = vec![FORM, logs[0], logs[1], flags];
    for number in [map.heights[0], map.heights[1], map.exposure, map.roof_slope] {
        bytes.extend(number.to_le_bytes());
    }
    let too_long = |_| Error::Argument("a block with too large a model".to_owned());
    bytes.extend(hints.step.to_le_bytes());
    bytes.extend(u16::try_from(model.len()).map_err(too_long)?.to_le_bytes());
    bytes.extend((symbols.len() as u32).to_le_bytes());
    bytes.extend(model);
    bytes.extend(symbols);
    Ok(bytes)
}

/// The block of [`encode`]d bytes, at a place. Bytes behind them are padding.
///
/// # Errors
///
/// What is wrong with the bytes.
pub fn decode(
    bytes: &[u8],
    (corner, side): ([f64; 2], f64),
) -> std::result::Result<BlockMap, String> {
    let Some((header, body)) = bytes.split_first_chunk::<HEADER_LENGTH>() else {
        return Err(format!("{} bytes of a block", bytes.len()));
    };
    let [form, side_log2, slices_log2, flags, rest @ ..] = *header;
    let is_possible = form == FORM && (5..=7).contains(&side_log2) && slices_log2 < side_log2;
    if !is_possible || flags > HAS_16_BITS | HAS_ALL_COLUMNS {
        return Err(format!(
            "an impossible block: form {form}, 2^{side_log2} texels, 2^{slices_log2} slices, flags {flags}"
        ));
    }
    let side_texels = 1 << side_log2;
    let mut map = BlockMap::new(side_texels, corner, side).map_err(|error| error.to_string())?;
    map.slices = 1 << slices_log2;
    let [s, t, m, n, a, b, c, d] = rest[16..].try_into().unwrap_or_default();
    let numbers: Vec<f32> = rest[..16]
        .as_chunks()
        .0
        .iter()
        .copied()
        .map(f32::from_le_bytes)
        .collect();
    if let [low, high, exposure, roof_slope] = numbers[..] {
        (map.heights, map.exposure, map.roof_slope) = ([low, high], exposure, roof_slope);
    }
    map.low_heights = (flags & HAS_16_BITS != 0).then(|| vec![0; side_texels * side_texels]);
    check(&map)?;
    let hints = Hints {
        step: u16::from_le_bytes([s, t]),
        has_all_columns: flags & HAS_ALL_COLUMNS != 0,
    };
    let (model, symbols) = (
        usize::from(u16::from_le_bytes([m, n])),
        u32::from_le_bytes([a, b, c, d]) as usize,
    );
    let parts = body.split_at_checked(model);
    let parts = parts.and_then(|(model, rest)| Some((model, rest.get(..symbols)?)));
    let Some((model, symbols)) = parts else {
        return Err(format!("{} bytes of {model} and {symbols}", body.len()));
    };
    let model = Model::decode(model, &sections::contexts()).ok_or("its model is broken")?;
    let tables = rans::Tables::new(&model.tables.iter().collect::<Vec<&Frequencies>>());
    let mut scratch = Vec::new();
    let mut player = Player {
        symbols: rans::Decoder::new(&tables, symbols, &mut scratch, true),
        model: &model,
        plane: 0,
        contexts: [0; LONGEST_ROW],
        errors: [0; LONGEST_ROW],
    };
    sections::walk(&mut player, &mut map, hints);
    player.symbols.finish().map_err(|error| error.to_string())?;
    Ok(map)
}

/// What is impossible about a block.
pub(super) fn check(map: &BlockMap) -> std::result::Result<(), String> {
    let numbers = [map.heights[0], map.heights[1], map.exposure, map.roof_slope];
    if numbers.iter().any(|number| !number.is_finite()) || numbers[0] > numbers[1] {
        return Err(format!("impossible heights or steps {numbers:?}"));
    }
    let texels = map.side_texels * map.side_texels;
    let is_whole = map.image.len() == super::layout::image_bytes(map.side_texels)
        && map
            .low_heights
            .as_ref()
            .is_none_or(|low| low.len() == texels);
    let is_sliced = map.slices.is_power_of_two() && map.slices < map.side_texels;
    if !is_whole || !is_sliced || !matches!(map.side_texels, 32 | 64 | 128) {
        return Err(format!(
            "a block of {} texels a side in {} slices with {} bytes",
            map.side_texels,
            map.slices,
            map.image.len()
        ));
    }
    Ok(())
}

/// The most codes of height that are not more than the exposure.
fn step(map: &BlockMap) -> u16 {
    let range = f64::from(map.heights[1]) - f64::from(map.heights[0]);
    // Beyond the range of 16 bits it is their greatest number, and 0 where there is no range.
    (f64::from(map.exposure) * f64::from(map.top_code()) / range) as u16
}

/// Writes down all errors with their contexts.
#[derive(Default)]
struct Recorder {
    predictors: Vec<Predictor>,
    counts: Vec<PlaneCounts>,
    /// Where in the symbols each plane begins.
    starts: Vec<usize>,
    contexts: Vec<u8>,
    errors: Vec<i32>,
}

impl Coder for Recorder {
    const KNOWS: bool = true;

    fn predictor(&mut self, plane: &Plane, places: &Places) -> Predictor {
        let cheapest = Predictor::ALL.into_iter();
        let cheapest = cheapest.min_by_key(|predictor| rows::cost(plane, places, *predictor));
        let predictor = cheapest.unwrap_or(Predictor::Left);
        self.predictors.push(predictor);
        self.starts.push(self.contexts.len());
        let contexts = sections::contexts()[self.counts.len() % PLANES];
        self.counts.push(vec![NO_COUNTS; contexts]);
        predictor
    }

    fn row(&mut self, contexts: &[u8], row: &mut Row) {
        let first = self.errors.len();
        self.errors.resize(first + contexts.len(), 0);
        row.differences(&mut self.errors[first..]);
        self.contexts.extend_from_slice(contexts);
        let Some(counts) = self.counts.last_mut() else {
            return;
        };
        for (&context, &error) in contexts.iter().zip(&self.errors[first..]) {
            if context != NOWHERE {
                counts[usize::from(context)][usize::from(token::split(error).0)] += 1;
            }
        }
    }
}

impl Recorder {
    /// The model and the symbols, as bytes.
    fn finish(mut self) -> (Vec<u8>, Vec<u8>) {
        let model = Model::new(self.predictors, &self.counts);
        let ends = self.starts[1..]
            .iter()
            .copied()
            .chain([self.contexts.len()]);
        for ((&start, end), map) in self.starts.iter().zip(ends).zip(&model.maps) {
            for context in &mut self.contexts[start..end] {
                *context = map[usize::from(*context)];
            }
        }
        let tables = rans::Tables::new(&model.tables.iter().collect::<Vec<&Frequencies>>());
        let symbols = rans::encode(&tables, &self.contexts, &self.errors, 0);
        (model.encode(&sections::contexts()), symbols)
    }
}

/// Reads errors back.
struct Player<'a> {
    symbols: rans::Decoder<'a>,
    model: &'a Model,
    /// The plane after the one that is read.
    plane: usize,
    contexts: [u8; LONGEST_ROW],
    errors: [i32; LONGEST_ROW],
}

impl Coder for Player<'_> {
    const KNOWS: bool = false;

    fn predictor(&mut self, _: &Plane, _: &Places) -> Predictor {
        let predictor = self.model.predictors[self.plane % PLANES];
        self.plane += 1;
        predictor
    }

    fn row(&mut self, contexts: &[u8], row: &mut Row) {
        let map = &self.model.maps[(self.plane - 1) % PLANES];
        let (own, errors) = (
            &mut self.contexts[..contexts.len()],
            &mut self.errors[..contexts.len()],
        );
        for (own, &context) in own.iter_mut().zip(contexts) {
            *own = map[usize::from(context)];
        }
        // Where no error can be other than 0, whole turns of the lanes are passed over: they leave them as they are.
        let blank = [map[usize::from(NOWHERE)]; LANES];
        let (turns, _) = own.as_chunks::<LANES>();
        let mut turn = 0;
        while turn < turns.len() {
            let is_blank = turns[turn] == blank;
            let alike = turns[turn..]
                .iter()
                .take_while(|own| (**own == blank) == is_blank);
            let end = turn + alike.count();
            let passed = LANES * turn..LANES * end;
            if is_blank {
                errors[passed].fill(0);
            } else {
                let contexts = turns[turn..end].as_flattened();
                self.symbols.decode(contexts, &mut errors[passed]);
            }
            turn = end;
        }
        row.sums(errors);
    }
}
