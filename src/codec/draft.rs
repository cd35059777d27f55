//! A block before its entropy code.

use super::Trace;

/// A block but for its entropy code.
#[derive(Clone, Debug)]
pub struct Draft {
    /// All is as the empty block says.
    pub(super) is_default: bool,
    /// The void mask.
    pub(super) head: Vec<u8>,
    pub(super) content: Content,
}

#[derive(Clone, Debug)]
pub(super) enum Content {
    Bytes(Vec<u8>),
    Symbols(Trace),
}

impl Draft {
    /// The draft as bytes, for this process to read again.
    pub fn to_bytes(&self) -> Vec<u8> {
        let (kind, content) = match &self.content {
            Content::Bytes(bytes) => (0, bytes.clone()),
            Content::Symbols(trace) => (1, trace.as_bytes()),
        };
        let head = (self.head.len() as u64).to_ne_bytes();
        [
            &[u8::from(self.is_default), kind],
            &head[..],
            &self.head,
            &content,
        ]
        .concat()
    }

    /// The draft that gave these bytes.
    ///
    /// # Panics
    /// If none did.
    pub fn from_bytes(bytes: &[u8]) -> Draft {
        let (flags, rest) = bytes.split_at(2);
        let (length, rest) = rest.split_at(8);
        let length = u64::from_ne_bytes(std::array::from_fn(|index| length[index]));
        let (head, content) = rest.split_at(length as usize);
        Draft {
            is_default: flags[0] != 0,
            head: head.to_vec(),
            content: match flags[1] {
                0 => Content::Bytes(content.to_vec()),
                _ => Content::Symbols(Trace::of_bytes(content)),
            },
        }
    }

    /// The coefficients in contexts, if that is how they are coded and there are any.
    pub fn trace(&self) -> Option<&Trace> {
        match &self.content {
            Content::Symbols(trace) if !self.is_default => Some(trace),
            _ => None,
        }
    }
}
