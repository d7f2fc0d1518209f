//! Map messages: round trips, bounds, canonical encodings and authentication.

use pingmap_packet::*;
use proptest::collection::vec;
use proptest::prelude::*;

use crate::golden;

const CONTEXT: &[u8] = b"model 7";

fn key() -> Key {
    Key::new(*b"the secret of a team of vehicles").unwrap()
}

/// The authenticator that a layout needs.
fn authenticator<'a>(layout: &Layout, key: &'a Key) -> Option<Authenticator<'a>> {
    layout.is_authenticated.then_some(Authenticator { key, context: CONTEXT })
}

fn encode(layout: &Layout, message: &MapMessage) -> Result<Vec<u8>, Error> {
    message.encode(layout, authenticator(layout, &key()))
}

fn decode(layout: &Layout, bytes: &[u8]) -> Result<(&'static Layout, MapMessage), Error> {
    MapMessage::decode(bytes, authenticator(layout, &key()))
}

fn layouts() -> impl Strategy<Value = &'static Layout> {
    proptest::sample::select(LAYOUTS.iter().collect::<Vec<_>>())
}

fn cell(has_depth: bool) -> impl Strategy<Value = Cell> {
    let depths = if has_depth { DEPTH_CELLS } else { 1 };
    (0..HORIZONTAL_CELLS, 0..HORIZONTAL_CELLS, 0..depths).prop_map(|(east, north, depth)| Cell { east, north, depth })
}

fn point(has_depth: bool) -> impl Strategy<Value = Point> {
    let levels = (0..INFORMATION_LEVELS, -MEAN_LEVELS..=MEAN_LEVELS);
    let fields = (cell(has_depth), cell(has_depth), levels);
    fields.prop_map(|(transmitter, receiver, (information, mean))| Point { transmitter, receiver, information, mean })
}

fn block(layout: &Layout) -> impl Strategy<Value = Block> + use<> {
    let correlations = vec(-CORRELATION_LEVELS..=CORRELATION_LEVELS, layout.correlations());
    let fields = (0..TIME_CELLS, vec(point(layout.has_depth), layout.points), correlations);
    fields.prop_map(|(time, points, correlations)| Block { time, points, correlations })
}

/// Any message within the bounds of its layout.
fn messages() -> impl Strategy<Value = (&'static Layout, MapMessage)> {
    layouts().prop_flat_map(|layout| {
        let models = if layout.is_authenticated { 1 } else { 1_u16 << 14 };
        let fields = (any::<u8>(), any::<u16>(), 0..models, vec(block(layout), layout.blocks));
        fields.prop_map(move |(sender, counter, model, blocks)| (layout, MapMessage { sender, counter, model, blocks }))
    })
}

/// A fixed message with different levels in its fields.
fn varied(layout: &Layout, sender: u8) -> MapMessage {
    let cell = |n: usize| Cell {
        east: (7 * n % 64) as u8,
        north: (11 * n % 64) as u8,
        depth: if layout.has_depth { (5 * n % 32) as u8 } else { 0 },
    };
    let point = |n: usize| Point {
        transmitter: cell(n + 1),
        receiver: cell(n + 20),
        information: (3 * n % 32) as u8,
        mean: (4 * n % 31) as i8 - 15,
    };
    let block = |n: usize| Block {
        time: (13 * n + 41) as u8 % 64,
        points: (0..layout.points).map(|place| point(n * layout.points + place)).collect(),
        correlations: (0..layout.correlations()).map(|place| ((n + 2 * place) % 7) as i8 - 3).collect(),
    };
    let model = if layout.is_authenticated { 0 } else { 0x2a5 };
    MapMessage { sender, counter: 0x1234, model, blocks: (0..layout.blocks).map(block).collect() }
}

/// Whether every number is within its bounds, which are repeated here.
fn is_within_bounds(layout: &Layout, message: &MapMessage) -> bool {
    let is_cell = |cell: &Cell| {
        let is_depth = if layout.has_depth { cell.depth < 32 } else { cell.depth == 0 };
        cell.east < 64 && cell.north < 64 && is_depth
    };
    let is_point = |point: &Point| {
        let is_level = point.information < 32 && (-15..=15).contains(&point.mean);
        is_cell(&point.transmitter) && is_cell(&point.receiver) && is_level
    };
    let is_block = |block: &Block| {
        let is_size = block.points.len() == layout.points && block.correlations.len() == layout.correlations();
        let is_pair = |level: &i8| (-3..=3).contains(level);
        is_size && block.time < 64 && block.points.iter().all(is_point) && block.correlations.iter().all(is_pair)
    };
    message.model < 1 << 14 && message.blocks.len() == layout.blocks && message.blocks.iter().all(is_block)
}

/// Asserts that the bytes are refused, or decode to values within bounds and are their canonical encoding.
fn check_canonical(bytes: &[u8]) -> Result<(), TestCaseError> {
    let key = key();
    for authenticator in [None, Some(Authenticator { key: &key, context: CONTEXT })] {
        if let Ok((layout, message)) = MapMessage::decode(bytes, authenticator) {
            prop_assert!(is_within_bounds(layout, &message), "{message:?}");
            let again = message.encode(layout, authenticator).unwrap();
            prop_assert_eq!(&bytes[..again.len()], &again);
            prop_assert!(bytes[again.len()..].iter().all(|&byte| byte == 0));
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn messages_round_trip((layout, message) in messages()) {
        let mut bytes = encode(layout, &message).unwrap();
        prop_assert!(bytes.len() <= layout.frame_bytes);
        prop_assert_eq!(bytes.len(), layout.length());
        prop_assert_eq!(Layout::of(&bytes), Some(layout));
        prop_assert_eq!(decode(layout, &bytes), Ok((layout, message.clone())));
        bytes.resize(layout.frame_bytes, 0);
        prop_assert_eq!(decode(layout, &bytes), Ok((layout, message)));
    }

    #[test]
    fn zeroing_the_check_number_in_bytes_equals_encoding_with_check_number_0((layout, message) in messages(), more in 0..40_usize) {
        let mut bytes = encode(layout, &message).unwrap();
        bytes.resize(bytes.len() + more, 0);
        let expected = encode(layout, &MapMessage { model: 0, ..message });
        prop_assert_eq!(Ok(layout.with_model_zeroed(&bytes)), expected);
    }

    #[test]
    fn zeroing_the_check_number_changes_no_other_bits(layout in layouts(), bytes in vec(any::<u8>(), 0..300)) {
        let model = if layout.is_authenticated { 0..0 } else { first_bit_of_body(layout)..first_bit_of_body(layout) + 14 };
        let mut expected = bytes.clone();
        model.filter(|bit| bit / 8 < bytes.len()).for_each(|bit| expected[bit / 8] &= !(1 << (bit % 8)));
        expected.truncate(layout.length());
        prop_assert_eq!(layout.with_model_zeroed(&bytes), expected);
    }

    #[test]
    fn random_bytes_are_refused_or_canonical(bytes in vec(any::<u8>(), 0..300)) {
        check_canonical(&bytes)?;
    }

    #[test]
    fn random_bytes_after_a_valid_id_are_refused_or_canonical(layout in layouts(), rest in vec(any::<u8>(), 0..300)) {
        check_canonical(&[id_bytes(layout), rest].concat())?;
    }

    #[test]
    fn a_damaged_message_is_refused_or_canonical(
        (layout, message) in messages(),
        flips in vec(any::<prop::sample::Index>(), 1..4),
        length in any::<prop::sample::Index>(),
    ) {
        let mut bytes = encode(layout, &message).unwrap();
        flips.iter().for_each(|flip| flip_bit(&mut bytes, flip.index(8 * layout.length())));
        check_canonical(&bytes)?;
        check_canonical(&bytes[..length.index(bytes.len())])?;
    }

    #[test]
    fn a_damaged_authenticated_message_is_refused((layout, message) in messages(), flip in any::<prop::sample::Index>()) {
        let mut layouts = LAYOUTS.iter().filter(|known| known.is_authenticated);
        let layout = layouts.find(|known| known.frame_bytes == layout.frame_bytes).unwrap();
        let message = MapMessage { sender: message.sender, ..varied(layout, 0) };
        let mut bytes = encode(layout, &message).unwrap();
        flip_bit(&mut bytes, flip.index(8 * layout.length()));
        prop_assert!(decode(layout, &bytes).is_err());
    }
}

fn id_bytes(layout: &Layout) -> Vec<u8> {
    let id = layout.id;
    if id < 128 { vec![(id << 1) as u8] } else { (id << 1 | 1).to_le_bytes().to_vec() }
}

fn flip_bit(bytes: &mut [u8], bit: usize) {
    bytes[bit / 8] ^= 1 << (bit % 8);
}

/// A change that makes a message invalid, and the expected error: field, minimum, maximum and value.
type Spoiler = (fn(&mut MapMessage), &'static str, f64, f64, f64);

const SPOILERS: [Spoiler; 12] = [
    (|m| m.blocks[0].points[1].information = 32, "information", 0.0, 31.0, 32.0),
    (|m| m.blocks[0].points[0].mean = 16, "mean", -15.0, 15.0, 16.0),
    (|m| m.blocks[0].points[2].mean = -16, "mean", -15.0, 15.0, -16.0),
    (|m| m.blocks[0].correlations[0] = 4, "correlation", -3.0, 3.0, 4.0),
    (|m| m.blocks[0].correlations[1] = -4, "correlation", -3.0, 3.0, -4.0),
    (|m| m.blocks[0].time = 64, "time", 0.0, 63.0, 64.0),
    (|m| m.blocks[0].points[0].transmitter.east = 64, "tx_east", 0.0, 63.0, 64.0),
    (|m| m.blocks[0].points[0].transmitter.north = 64, "tx_north", 0.0, 63.0, 64.0),
    (|m| m.blocks[0].points[0].receiver.east = 255, "rx_east", 0.0, 63.0, 255.0),
    (|m| m.blocks[0].points[0].receiver.north = 64, "rx_north", 0.0, 63.0, 64.0),
    // These are the bounds of layouts with depth. The other layouts allow only depth 0.
    (|m| m.blocks[0].points[0].transmitter.depth = 32, "tx_depth", 0.0, 31.0, 32.0),
    (|m| m.blocks[0].points[0].receiver.depth = 32, "rx_depth", 0.0, 31.0, 32.0),
];

#[test]
fn the_error_for_a_level_out_of_bounds_names_field_bounds_and_value() {
    for layout in &LAYOUTS {
        for (spoil, field, min, max, value) in SPOILERS {
            let mut message = varied(layout, 3);
            spoil(&mut message);
            let is_depth = field.ends_with("depth");
            let (field, max) = if is_depth && !layout.has_depth { ("depth", 0.0) } else { (field, max) };
            let expected = Error::OutOfBounds { field: field.into(), min, max, value };
            assert_eq!(encode(layout, &message), Err(expected.clone()), "{}", layout.name);
            let text = expected.to_string();
            assert!([field, &min.to_string(), &max.to_string(), &value.to_string()].iter().all(|s| text.contains(s)));
        }
    }
}

#[test]
fn a_depth_in_a_layout_without_depth_is_refused() {
    for layout in LAYOUTS.iter().filter(|layout| !layout.has_depth) {
        let mut message = varied(layout, 3);
        message.blocks.last_mut().unwrap().points.last_mut().unwrap().receiver.depth = 1;
        let expected = Error::OutOfBounds { field: "depth".into(), min: 0.0, max: 0.0, value: 1.0 };
        assert_eq!(encode(layout, &message), Err(expected));
    }
}

#[test]
fn a_check_number_of_more_than_14_bits_is_refused_in_a_plain_message() {
    for layout in LAYOUTS.iter().filter(|layout| !layout.is_authenticated) {
        let message = |model| MapMessage { model, ..varied(layout, 3) };
        let expected = Error::OutOfBounds { field: "model".into(), min: 0.0, max: 16383.0, value: 16384.0 };
        assert_eq!(encode(layout, &message(1 << 14)), Err(expected));
        assert!(encode(layout, &message((1 << 14) - 1)).is_ok());
    }
}

#[test]
fn an_authenticated_message_does_not_contain_the_check_number() {
    for layout in LAYOUTS.iter().filter(|layout| layout.is_authenticated) {
        let message = varied(layout, 3);
        let bytes = encode(layout, &MapMessage { model: 77, ..message.clone() }).unwrap();
        assert_eq!(decode(layout, &bytes), Ok((layout, message)));
    }
}

/// A change of a number of elements, and the field that the error must name.
type Resizer = (fn(&mut MapMessage), &'static str);

#[test]
fn the_error_for_a_wrong_number_of_elements_names_the_field() {
    let spoilers: [Resizer; 6] = [
        (|m| m.blocks.clear(), "blocks"),
        (|m| m.blocks.push(m.blocks[0].clone()), "blocks"),
        (|m| m.blocks[0].points.push(Point::default()), "points of block 0"),
        (|m| m.blocks[0].points.truncate(1), "points of block 0"),
        (|m| m.blocks[0].correlations.push(0), "correlations of block 0"),
        (|m| m.blocks[0].correlations.truncate(1), "correlations of block 0"),
    ];
    for layout in &LAYOUTS {
        for (spoil, name) in spoilers {
            let mut message = varied(layout, 3);
            spoil(&mut message);
            let error = encode(layout, &message).unwrap_err();
            assert!(matches!(&error, Error::Count { field, .. } if field == name), "{}: {error}", layout.name);
        }
    }
}

/// The first bit after id, sender and counter, which are whole bytes.
fn first_bit_of_body(layout: &Layout) -> usize {
    if layout.id < 128 { 32 } else { 40 }
}

/// The first bit of a field of the body, and the width of one element.
fn place_of(layout: &Layout, name: &str, count: usize) -> (usize, usize) {
    let head = first_bit_of_body(layout);
    let schema = layout.schema();
    let bits = schema.bits();
    let (before, field) = (bits.iter().skip(2).take_while(|(known, _)| *known != name), bits.iter());
    let (_, width) = *field.clone().find(|(known, _)| *known == name).unwrap();
    (head + before.map(|(_, width)| *width as usize).sum::<usize>(), width as usize / count)
}

#[test]
fn codes_beyond_the_bounds_are_refused_by_the_decoder() {
    for layout in &LAYOUTS {
        let points = layout.blocks * layout.points;
        let correlations = layout.blocks * layout.correlations();
        for (name, count, max) in [("mean", points, 15.0), ("correlation", correlations, 3.0)] {
            for element in [0, count - 1] {
                let mut bytes = encode(layout, &varied(layout, 3)).unwrap();
                let (start, width) = place_of(layout, name, count);
                let bits = (start + element * width)..(start + (element + 1) * width);
                bits.for_each(|bit| bytes[bit / 8] |= 1 << (bit % 8));
                let expected = Error::OutOfBounds { field: name.into(), min: -max, max, value: max + 1.0 };
                assert_eq!(decode(layout, &bytes), Err(expected), "{}", layout.name);
            }
        }
    }
}

#[test]
fn a_set_padding_bit_is_refused() {
    for layout in &LAYOUTS {
        let schema = layout.schema();
        let head = first_bit_of_body(layout);
        let used = head + schema.bits().iter().skip(2).map(|(_, bits)| *bits as usize).sum::<usize>();
        for bit in used..8 * layout.length() {
            let mut bytes = encode(layout, &varied(layout, 3)).unwrap();
            flip_bit(&mut bytes, bit);
            assert_eq!(decode(layout, &bytes), Err(Error::Padding), "{}, bit {bit}", layout.name);
        }
    }
}

#[test]
fn every_single_flipped_bit_of_an_authenticated_message_is_refused() {
    for layout in LAYOUTS.iter().filter(|layout| layout.is_authenticated) {
        // With sender 0, flipping the lowest bit of a short id gives the two bytes of a long id.
        for sender in [0, 3, 255] {
            let bytes = encode(layout, &varied(layout, sender)).unwrap();
            for bit in 0..8 * bytes.len() {
                let mut bytes = bytes.clone();
                flip_bit(&mut bytes, bit);
                let error = decode(layout, &bytes).unwrap_err();
                let is_expected = match error {
                    Error::Forged | Error::OutOfBounds { .. } | Error::Padding => true,
                    // The part of the tag that depends on the context.
                    Error::OtherContext => (8 * (layout.length() - 8) - 8..8 * layout.length()).contains(&bit),
                    // A changed id belongs to another form or to no form.
                    Error::Id { .. } | Error::Authentication(_) | Error::Short { .. } | Error::Long { .. } => bit < 16,
                    _ => false,
                };
                assert!(is_expected, "{}, bit {bit}: {error}", layout.name);
            }
        }
    }
}

#[test]
fn an_id_below_128_in_two_bytes_is_refused() {
    for layout in LAYOUTS.iter().filter(|layout| layout.id < 128) {
        let mut bytes = encode(layout, &varied(layout, 0)).unwrap();
        flip_bit(&mut bytes, 0);
        assert!(matches!(decode(layout, &bytes), Err(Error::Id { .. })), "{}", layout.name);
        assert!(matches!(layout.schema().decode(&bytes), Err(Error::Id { .. })), "{}", layout.name);
    }
}

#[test]
fn only_the_same_key_and_context_verify_an_authenticated_message() {
    let (key, other) = (key(), Key::new(*b"another secret for another team!").unwrap());
    for layout in LAYOUTS.iter().filter(|layout| layout.is_authenticated) {
        let bytes = encode(layout, &varied(layout, 3)).unwrap();
        let verify = |key, context| MapMessage::decode(&bytes, Some(Authenticator { key, context })).map(|_| ());
        assert_eq!(verify(&key, CONTEXT), Ok(()));
        assert_eq!(verify(&other, CONTEXT), Err(Error::Forged));
        for context in [&b""[..], b"model 8", b"model 7 ", b"model "] {
            assert_eq!(verify(&key, context), Err(Error::OtherContext));
        }
    }
}

#[test]
fn messages_of_another_length_are_refused() {
    for layout in &LAYOUTS {
        let bytes = encode(layout, &varied(layout, 3)).unwrap();
        for length in 0..bytes.len() {
            let error = decode(layout, &bytes[..length]).unwrap_err();
            assert!(matches!(error, Error::Short { .. } | Error::Id { .. }), "{}: {error}", layout.name);
        }
        for extra in [&[1][..], &[0, 0, 128], &[255; 300]] {
            let longer = [&bytes[..], extra].concat();
            assert_eq!(decode(layout, &longer), Err(Error::Long { extra: extra.len() }), "{}", layout.name);
        }
    }
}

/// A layout outside `LAYOUTS` may describe an invalid message. Encoding then gives an error instead of unreadable
/// bytes.
#[test]
fn the_schema_of_an_unknown_layout_is_checked() {
    for layout in &LAYOUTS {
        let encoded = |layout: Layout| encode(&layout, &varied(&layout, 3));
        let frame_bytes = layout.length() - 1;
        let expected = Error::TooLong { length: layout.length(), max: frame_bytes };
        assert_eq!(encoded(Layout { frame_bytes, ..*layout }), Err(expected));
        assert!(matches!(encoded(Layout { id: 40_000, ..*layout }), Err(Error::Schema { .. })));
        assert!(matches!(encoded(Layout { points: 0, ..*layout }), Err(Error::Schema { .. })));
        let other = Layout { name: "Other", points: 2, blocks: 1, ..*layout };
        assert_eq!(encoded(other).unwrap().len(), other.length());
    }
}

#[test]
fn a_key_is_required_exactly_for_authenticated_messages() {
    let key = key();
    for layout in &LAYOUTS {
        let message = varied(layout, 3);
        let right = authenticator(layout, &key);
        let wrong = if layout.is_authenticated { None } else { Some(Authenticator { key: &key, context: CONTEXT }) };
        let bytes = message.encode(layout, right).unwrap();
        assert!(matches!(message.encode(layout, wrong), Err(Error::Authentication(_))), "{}", layout.name);
        assert!(matches!(MapMessage::decode(&bytes, wrong), Err(Error::Authentication(_))), "{}", layout.name);
    }
}

/// Deployed vehicles cannot follow a change of the format. An intended change needs another version of the protocol, an
/// entry in CHANGELOG.md, and new golden bytes (`PINGMAP_WRITE_GOLDEN=1`).
#[test]
fn encodings_match_the_golden_bytes() {
    let frame = |layout| {
        let bytes = encode(layout, &varied(layout, 3)).unwrap();
        format!("{} {}\n", layout.name, to_hex(&bytes))
    };
    let found: String = LAYOUTS.iter().map(frame).collect();
    golden::check("tests/golden/frames.txt", &found);
}
