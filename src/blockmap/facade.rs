//! Facades and roofs for buildings that have no textures.

/// Bricks, plasters and stones.
const WALLS: [[u8; 3]; 12] = [
    [150, 92, 72],
    [134, 78, 62],
    [168, 112, 84],
    [122, 84, 70],
    [214, 206, 190],
    [226, 214, 180],
    [198, 190, 184],
    [208, 178, 150],
    [182, 196, 198],
    [170, 164, 154],
    [188, 176, 150],
    [150, 148, 146],
];
/// Tiles and slates.
const ROOFS: [[u8; 3]; 8] = [
    [158, 82, 62],
    [142, 70, 56],
    [172, 98, 72],
    [126, 72, 60],
    [96, 102, 112],
    [84, 88, 96],
    [112, 114, 118],
    [128, 122, 114],
];
const FRAMES: [[f32; 3]; 4] = [
    [236.0, 234.0, 228.0],
    [86.0, 78.0, 70.0],
    [60.0, 84.0, 72.0],
    [200.0, 196.0, 186.0],
];
const DOORS: [[f32; 3]; 4] = [
    [96.0, 60.0, 44.0],
    [52.0, 78.0, 62.0],
    [60.0, 66.0, 92.0],
    [112.0, 40.0, 38.0],
];
const GLASS: [f32; 3] = [70.0, 86.0, 102.0];
/// A window that mirrors the sky.
const SKY: [f32; 3] = [142.0, 164.0, 186.0];
/// A window behind which a lamp is on.
const LAMP: [f32; 3] = [232.0, 204.0, 142.0];
/// Share of a storey that the line at its foot takes.
const SILL: f32 = 0.06;
/// Share of a window that its frame takes at each edge.
const FRAME: f32 = 0.12;

/// A rectangle of a window's place on the wall: left, right, lower and upper edge, each from 0 to 1.
type Opening = [f32; 4];

/// The colour of a facade, red, green and blue from 0 to 255, at so many windows along the wall and storeys above the
/// ground. A window lies within whole numbers, so that a wall from one whole number to another cuts none. Any
/// coordinates have a colour; the same ones always the same.
pub fn colour(seed: u32, at: [f32; 2]) -> [f32; 3] {
    let [bay, storey] = at.map(|along| along.floor());
    let place =
        [at[0] - bay, at[1] - storey].map(|share| if share.is_finite() { share } else { 0.0 });
    // A cast from floating point keeps to the range, and makes 0 of what is no number.
    let (bay, storey) = (bay as i32, storey as i32);
    let wall = wall(seed).map(f32::from);
    if storey < 0 {
        return wall.map(|band| 0.7 * band);
    }
    if storey == 0 {
        return ground_storey(seed, bay, place, wall);
    }
    if place[1] < SILL {
        return wall.map(|band| (1.12 * band + 8.0).min(255.0));
    }
    let chosen = hash(seed, 2, 0);
    let width = 0.36 + 0.08 * (chosen % 4) as f32;
    let top = 0.72 + 0.04 * (chosen / 4 % 4) as f32;
    let opening = [0.5 - width / 2.0, 0.5 + width / 2.0, 0.28, top];
    window(seed, bay, storey, place, opening).unwrap_or(wall)
}

/// The wall's own colour.
pub(super) fn wall(seed: u32) -> [u8; 3] {
    WALLS[hash(seed, 0, 0) as usize % WALLS.len()]
}

/// The colour of a building's roof.
pub(super) fn roof(seed: u32) -> [u8; 3] {
    ROOFS[hash(seed, 1, 0) as usize % ROOFS.len()]
}

/// Shopfronts on some buildings, on the others a door here and there.
fn ground_storey(seed: u32, bay: i32, place: [f32; 2], wall: [f32; 3]) -> [f32; 3] {
    let chosen = hash(seed, 3, 0);
    if chosen.is_multiple_of(3) {
        if (0.8..0.94).contains(&place[1]) {
            return DOORS[(chosen / 3) as usize % DOORS.len()].map(|band| 0.85 * band + 30.0);
        }
        let shop = [0.08, 0.92, 0.12, 0.76];
        return window(seed, bay, 0, place, shop).unwrap_or(wall);
    }
    let has_door = bay.rem_euclid(4) == (chosen / 3 % 4) as i32;
    if has_door && (0.32..0.68).contains(&place[0]) && place[1] < 0.74 {
        return DOORS[(chosen / 12) as usize % DOORS.len()];
    }
    if place[1] < 2.0 * SILL {
        return wall.map(|band| 0.8 * band);
    }
    if has_door {
        return wall;
    }
    window(seed, bay, 0, place, [0.28, 0.72, 0.32, 0.78]).unwrap_or(wall)
}

/// The frame or the glass; `None` beside the opening.
fn window(
    seed: u32,
    bay: i32,
    storey: i32,
    [across, up]: [f32; 2],
    [left, right, lower, upper]: Opening,
) -> Option<[f32; 3]> {
    if !(left..right).contains(&across) || !(lower..upper).contains(&up) {
        return None;
    }
    let frame = FRAME * (right - left).min(upper - lower);
    let nearest = (across - left)
        .min(right - across)
        .min(up - lower)
        .min(upper - up);
    if nearest < frame {
        return Some(FRAMES[hash(seed, 4, 0) as usize % FRAMES.len()]);
    }
    let chosen = hash(seed, bay, storey.wrapping_add(16));
    let share = (chosen / 16 % 8) as f32 / 8.0;
    Some(match chosen % 16 {
        0 => LAMP,
        1..=4 => [0, 1, 2].map(|band| GLASS[band] + share * (SKY[band] - GLASS[band])),
        _ => GLASS.map(|band| band * (0.8 + 0.3 * share)),
    })
}

/// Bits that look random, and are the same for the same numbers.
fn hash(seed: u32, first: i32, second: i32) -> u32 {
    [first, second]
        .iter()
        .fold(seed ^ 0x9e37_79b9, |bits, &number| {
            let bits = (bits ^ number as u32).wrapping_mul(0x85eb_ca6b);
            let bits = (bits ^ bits >> 15).wrapping_mul(0xc2b2_ae35);
            bits ^ bits >> 13
        })
}
