//! Little-endian fields of untrusted bytes, read in order and never past the end.

/// The bytes that are still to be read.
pub(super) struct Fields<'a>(pub(super) &'a [u8]);

impl<'a> Fields<'a> {
    fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let (head, tail) = self.0.split_first_chunk().ok_or("ends inside a field")?;
        self.0 = tail;
        Ok(*head)
    }

    pub(super) fn u8(&mut self) -> Result<u8, String> {
        self.array().map(u8::from_le_bytes)
    }

    pub(super) fn u16(&mut self) -> Result<u16, String> {
        self.array().map(u16::from_le_bytes)
    }

    pub(super) fn u32(&mut self) -> Result<u32, String> {
        self.array().map(u32::from_le_bytes)
    }

    pub(super) fn i32(&mut self) -> Result<i32, String> {
        self.array().map(i32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Result<u64, String> {
        self.array().map(u64::from_le_bytes)
    }

    pub(super) fn f64(&mut self) -> Result<f64, String> {
        self.array().map(f64::from_le_bytes)
    }

    /// A `u32` length and that many bytes.
    pub(super) fn bytes(&mut self) -> Result<&'a [u8], String> {
        let length = self.u32()?;
        let split = usize::try_from(length)
            .ok()
            .and_then(|length| self.0.split_at_checked(length));
        let (head, tail) = split.ok_or_else(|| format!("ends inside a field of {length} bytes"))?;
        self.0 = tail;
        Ok(head)
    }

    /// Bytes that are UTF-8.
    pub(super) fn string(&mut self) -> Result<String, String> {
        let bytes = self.bytes()?;
        let text =
            std::str::from_utf8(bytes).map_err(|error| format!("text is not UTF-8: {error}"))?;
        Ok(text.to_owned())
    }
}
