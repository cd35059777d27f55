//! Planes of values, row by row: how each value is foreseen, and in which context its error is coded.

use crate::vectors::widened;

/// Rows are as long as a multiple of this, so that lanes of the entropy coder fill them.
pub const LANES: usize = 8;
/// Contexts of a zone: activities times companions.
pub const ZONE_CONTEXTS: u8 = ACTIVITIES * COMPANIONS;
const ACTIVITIES: u8 = 6;
const COMPANIONS: u8 = 3;
/// The zone and the context of what is not there: its error is 0 and takes no bits.
pub const NOWHERE: u8 = u8::MAX;
/// Greatest size of an error that contexts tell from others: four of them fit a byte.
const MOST_SIZE: u32 = 63;

/// How a value is foreseen from the ones before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Predictor {
    /// By 0.
    Zero,
    /// By the one to the left.
    Left,
    /// By the one above.
    Above,
    /// By left + above - their corner, at least the smaller and at most the greater of the two.
    Gradient,
    /// By the mean of left and above.
    Mean,
    /// By the neighbour that the shape tells.
    Guided,
}

impl Predictor {
    /// All, by their numbers.
    pub const ALL: [Predictor; 6] = [
        Predictor::Zero,
        Predictor::Left,
        Predictor::Above,
        Predictor::Gradient,
        Predictor::Mean,
        Predictor::Guided,
    ];
}

/// The neighbour that a value is foreseen by, as the shape tells.
pub mod guide {
    pub const LEFT: u8 = 0;
    pub const ABOVE: u8 = 1;
    pub const CORNER: u8 = 2;
    pub const ABOVE_RIGHT: u8 = 3;
}

/// Values of one kind, row by row.
#[derive(Clone, Debug)]
pub struct Plane {
    /// Values along a row; those beyond the end of the image are 0.
    pub width: usize,
    pub values: Vec<u16>,
    /// Sizes of their errors, for the contexts of others.
    pub sizes: Vec<u8>,
    /// Bits of a value.
    pub bits: u32,
}

/// What is known of the places of a plane before its values are.
#[derive(Clone, Debug)]
pub struct Places {
    /// For each place its zone, which says how well it can be foreseen.
    pub zones: Vec<u8>,
    /// For each place the neighbour that is most like it.
    pub guides: Vec<u8>,
    /// Rows after which one begins that has none above it.
    pub period: usize,
}

impl Plane {
    /// Zeros.
    pub fn new(width: usize, rows: usize, bits: u32) -> Plane {
        let width = width.next_multiple_of(LANES);
        Plane {
            width,
            values: vec![0; width * rows],
            sizes: vec![0; width * rows],
            bits,
        }
    }
}

/// What drives rows: an encoder that knows the values, or a decoder that finds them.
pub trait Coder {
    /// Whether planes hold values before they are passed.
    const KNOWS: bool;

    /// The predictor of the next plane.
    fn predictor(&mut self, plane: &Plane, places: &Places) -> Predictor;

    /// Passes the errors of a row. They have contexts below [`NOWHERE`] where they can be other than 0.
    fn row(&mut self, contexts: &[u8], row: &mut Row);
}

/// A row with the one above it.
pub struct Row<'a> {
    predictor: Predictor,
    bits: u32,
    above: &'a [u16],
    guides: &'a [u8],
    zones: &'a [u8],
    values: &'a mut [u16],
    sizes: &'a mut [u8],
}

/// Passes all values of a plane; the errors of `companion`, at the same places, help to foresee the sizes of its own.
pub fn pass(coder: &mut impl Coder, plane: &mut Plane, places: &Places, companion: Option<&Plane>) {
    let predictor = coder.predictor(plane, places);
    let width = plane.width;
    let none = (vec![0u16; width], vec![0u8; width]);
    let mut contexts = vec![0; width];
    for line in 0..plane.values.len() / width.max(1) {
        let here = line * width..(line + 1) * width;
        let (before, values) = plane.values.split_at_mut(here.start);
        let (sizes_before, sizes) = plane.sizes.split_at_mut(here.start);
        let begins = line % places.period == 0;
        let (above, sizes_above) = if begins {
            (&none.0[..], &none.1[..])
        } else {
            let first = here.start - width;
            (&before[first..], &sizes_before[first..])
        };
        let companion = companion.map_or(&none.1[..], |other| &other.sizes[here.clone()]);
        find_contexts(
            sizes_above,
            companion,
            &places.zones[here.clone()],
            &mut contexts,
        );
        let mut row = Row {
            predictor: match predictor {
                Predictor::Zero => Predictor::Zero,
                _ if begins => Predictor::Left,
                other => other,
            },
            bits: plane.bits,
            above,
            guides: &places.guides[here.clone()],
            zones: &places.zones[here],
            values: &mut values[..width],
            sizes: &mut sizes[..width],
        };
        coder.row(&contexts, &mut row);
    }
}

widened! {
    /// The context of each error: by the sizes of the three above it, of the companion's, and by its zone.
    fn find_contexts(above: &[u8], companion: &[u8], zones: &[u8], contexts: &mut [u8]) {
        let width = contexts.len();
        let (above, companion, zones) = (&above[..width], &companion[..width], &zones[..width]);
        for (sum, &own) in contexts.iter_mut().zip(above) {
            *sum = 2 * own;
        }
        for (sum, &left) in contexts[1..].iter_mut().zip(above) {
            *sum += left;
        }
        for (sum, &right) in contexts.iter_mut().zip(&above[1..]) {
            *sum += right;
        }
        for index in 0..width {
            let size = contexts[index];
            let activity = u8::from(size > 0)
                + u8::from(size > 1)
                + u8::from(size > 3)
                + u8::from(size > 8)
                + u8::from(size > 20);
            let other = u8::from(companion[index] > 0) + u8::from(companion[index] > 2);
            let zone = zones[index];
            let context = activity
                .wrapping_add(other * ACTIVITIES)
                .wrapping_add(zone.wrapping_mul(ZONE_CONTEXTS));
            contexts[index] = if zone == NOWHERE { NOWHERE } else { context };
        }
    }
}

impl Row<'_> {
    /// The errors of known values.
    pub fn differences(&mut self, errors: &mut [i32]) {
        let (values, bits) = (&*self.values, self.bits);
        let zones = &self.zones[..values.len()];
        self.foresee(values.len(), |index, foreseen| {
            let error = signed(i32::from(values[index]) - i32::from(foreseen), bits);
            errors[index] = if zones[index] == NOWHERE { 0 } else { error };
            values[index]
        });
        find_sizes(errors, self.bits, self.sizes);
    }

    /// The values of known errors. Any errors give some.
    pub fn sums(&mut self, errors: &[i32]) {
        find_sizes(errors, self.bits, self.sizes);
        let mask = mask(self.bits);
        if self.predictor == Predictor::Above {
            return add(self.values, self.above, errors, self.zones, mask);
        }
        let values = std::mem::take(&mut self.values);
        let zones = &self.zones[..values.len()];
        let errors = &errors[..values.len()];
        self.foresee(values.len(), |index, foreseen| {
            let value = foreseen.wrapping_add(errors[index] as u16) & kept(zones[index], mask);
            values[index] = value;
            value
        });
        self.values = values;
    }

    /// Foresees each value in turn; `pass` returns what it is.
    #[inline(always)]
    fn foresee(&self, width: usize, mut pass: impl FnMut(usize, u16) -> u16) {
        let (above, guides) = (&self.above[..width], &self.guides[..width]);
        let pass = &mut pass;
        match self.predictor {
            Predictor::Zero => each(width, pass, |_, _| 0),
            Predictor::Left => each(width, pass, |left, _| left),
            Predictor::Above => each(width, pass, |_, index| above[index]),
            Predictor::Gradient => each(width, pass, |left, index| {
                gradient(left, above[index], above[index.max(1) - 1])
            }),
            Predictor::Mean => each(width, pass, |left, index| {
                (left & above[index]) + ((left ^ above[index]) >> 1)
            }),
            Predictor::Guided => each(width, pass, |left, index| match guides[index] {
                guide::LEFT => left,
                guide::ABOVE => above[index],
                guide::CORNER => above[index.max(1) - 1],
                _ => above[(index + 1).min(width - 1)],
            }),
        }
    }
}

#[inline(always)]
fn each(
    width: usize,
    pass: &mut impl FnMut(usize, u16) -> u16,
    foresee: impl Fn(u16, usize) -> u16,
) {
    let mut left = 0;
    for index in 0..width {
        left = pass(index, foresee(left, index));
    }
}

#[inline(always)]
fn gradient(left: u16, above: u16, corner: u16) -> u16 {
    let (low, high) = (left.min(above), left.max(above));
    let plane = i32::from(left) + i32::from(above) - i32::from(corner);
    plane.clamp(i32::from(low), i32::from(high)) as u16
}

/// What is kept of a value: nothing where there is none.
#[inline(always)]
fn kept(zone: u8, mask: u16) -> u16 {
    if zone == NOWHERE { 0 } else { mask }
}

widened! {
    fn add(values: &mut [u16], above: &[u16], errors: &[i32], zones: &[u8], mask: u16) {
        let known = above.iter().zip(errors).zip(zones);
        for (value, ((&above, &error), &zone)) in values.iter_mut().zip(known) {
            *value = above.wrapping_add(error as u16) & kept(zone, mask);
        }
    }
}

widened! {
    fn find_sizes(errors: &[i32], bits: u32, sizes: &mut [u8]) {
        for (size, &error) in sizes.iter_mut().zip(errors) {
            *size = signed(error, bits).unsigned_abs().min(MOST_SIZE) as u8;
        }
    }
}

/// The greatest value of so many bits.
pub fn mask(bits: u32) -> u16 {
    ((1u32 << bits) - 1) as u16
}

/// An error among those that are alike, the one nearest to 0.
#[inline(always)]
fn signed(error: i32, bits: u32) -> i32 {
    error << (32 - bits) >> (32 - bits)
}

/// What the errors of a plane would take with a predictor, about: the sum of their bit lengths.
pub fn cost(plane: &Plane, places: &Places, predictor: Predictor) -> u64 {
    /// Adds bit lengths.
    struct Sum {
        predictor: Predictor,
        errors: Vec<i32>,
        total: u64,
    }
    impl Coder for Sum {
        const KNOWS: bool = true;

        fn predictor(&mut self, _: &Plane, _: &Places) -> Predictor {
            self.predictor
        }
        fn row(&mut self, _: &[u8], row: &mut Row) {
            row.differences(&mut self.errors);
            let length = |error: &i32| u64::from(32 - error.unsigned_abs().leading_zeros());
            self.total += self.errors.iter().map(length).sum::<u64>();
        }
    }
    let mut sum = Sum {
        predictor,
        errors: vec![0; plane.width],
        total: 0,
    };
    pass(&mut sum, &mut plane.clone(), places, None);
    sum.total
}
