// The page's codec against the golden bytes of protocol/vectors: PROTOCOL.md sections 6, 7 and 10.
import assert from 'node:assert/strict';
import { readFileSync, readdirSync } from 'node:fs';
import { test } from 'node:test';
import {
  closePolicy, decodePicture,
} from '../../clients/js/protocol.js';
import { decodeEnvironment, encodeEnvironment, encodePicture } from './headers.mjs';

const folder = new URL('../../protocol/vectors/', import.meta.url);
const vectors = readdirSync(folder).filter((name) => name.endsWith('.json')).map((name) => ({
  name,
  ...JSON.parse(readFileSync(new URL(name, folder), 'utf8')),
  data: new Uint8Array(readFileSync(new URL(name.replace(/json$/, 'bin'), folder))),
}));
const decode = (v, data = v.data) => (v.kind === 'picture' ? decodePicture(data) : decodeEnvironment(data));

test('the vectors are complete', () => assert.ok(vectors.length >= 30));

for (const v of vectors) {
  test(`${v.name}: ${v.about}`, () => {
    const got = decode(v);
    if (v.fails) {
      assert.equal(got.ok, false);
      assert.equal(got.clause, v.fails);
      return;
    }
    assert.equal(got.ok, true);
    assert.deepEqual(got.header, v.header);
    assert.equal(Buffer.from(got.payload).toString('hex'), v.payload_hex);
    // the same bytes anywhere in a larger buffer
    const shifted = new Uint8Array(v.data.length + 13);
    shifted.set(v.data, 5);
    assert.deepEqual(decode(v, shifted.subarray(5, 5 + v.data.length)).header, v.header);
  });
}

test('messages truncated at any byte are refused', () => {
  for (const v of vectors.filter((each) => !each.fails))
    for (let size = 0; size < v.data.length; size++) {
      const got = decode(v, v.data.slice(0, size));
      assert.equal(got.ok, false, `${v.name} cut at ${size}`);
      assert.ok(['short', 'length'].includes(got.result), `${v.name} cut at ${size}: ${got.result}`);
    }
});

test('the encoder produces the golden bytes', () => {
  for (const v of vectors.filter((each) => !each.fails && !each.unknown)) {
    const bytes = v.kind === 'picture' ? encodePicture(v.header) : encodeEnvironment(v.header);
    assert.deepEqual(bytes, v.data.slice(0, bytes.length), v.name);
  }
});

test('every close code of section 8 has its policy', () => {
  const text = readFileSync(new URL('../../protocol/PROTOCOL.md', import.meta.url), 'utf8');
  const rows = [...text.matchAll(/^\|[^|]*\| (\d{4}) \|[^|]*\| (again|later|never) \|$/gm)];
  assert.ok(rows.length >= 15);
  for (const [, code, policy] of rows) assert.equal(closePolicy(Number(code)).policy, policy, code);
});
