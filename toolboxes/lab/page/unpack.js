// Unpacking of the compiled loops, concatenated in one Zstandard frame in base64.

// {names: {name: bytes}, zstd: base64} → {name: Uint8Array}
export function unpack(packed) {
  const bytes = fzstd.decompress(Uint8Array.from(atob(packed.zstd), (letter) => letter.charCodeAt(0)));
  let start = 0;
  return Object.fromEntries(Object.entries(packed.names).map(([name, length]) => [name, bytes.slice(start, (start += length))]));
}
