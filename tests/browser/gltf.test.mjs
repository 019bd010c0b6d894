// Every glTF file that the tests generate and the program accepts is valid by Khronos' validator.
import assert from 'node:assert/strict';
import { execFileSync, spawnSync } from 'node:child_process';
import fs from 'node:fs';
import os from 'node:os';
import path from 'node:path';
import { test } from 'node:test';
import { fileURLToPath } from 'node:url';

const here = path.dirname(fileURLToPath(import.meta.url));
const { default: validator } = await import('gltf-validator').catch(() => ({}));
const skip = !validator && 'skipped: gltf-validator is not installed (npm ci)';

// The errors of a file, one a line.
async function errorsOf(file) {
  const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)), {
    uri: path.basename(file),
    maxIssues: 0,
    externalResourceFunction: async (uri) => new Uint8Array(fs.readFileSync(path.join(path.dirname(file), decodeURIComponent(uri)))),
  });
  return report.issues.messages.filter(({ severity }) => severity === 0)
    .map(({ code, message, pointer }) => `${pointer ?? ''}: ${code}: ${message}`);
}

function temporary(t) {
  const folder = fs.mkdtempSync(path.join(os.tmpdir(), 'relight-gltf-'));
  t.after(() => fs.rmSync(folder, { recursive: true }));
  return folder;
}

test('the validator sees a planted fault', { skip }, async (t) => {
  const file = path.join(temporary(t), 'a.gltf');
  fs.writeFileSync(file, JSON.stringify({ asset: { version: '2.0' }, nodes: [{ mesh: 0 }] }));
  assert.match((await errorsOf(file)).join(), /UNRESOLVED_REFERENCE/);
});

test('models that are compared with Cycles are valid', { skip }, async (t) => {
  const folder = temporary(t);
  execFileSync('python3', [path.join(here, '../references/generate.py'), folder]);
  const names = fs.readdirSync(folder);
  assert.equal(names.length, 3);
  for (const name of names) assert.deepEqual(await errorsOf(path.join(folder, name)), [], name);
});

test('models that unit tests write and load are valid', { skip }, async (t) => {
  const folder = temporary(t);
  const programs = process.env.RELIGHT_GLTF_TESTS.split(',');
  const run = { env: { ...process.env, RELIGHT_KEEP_GLTF: folder }, stdio: 'pipe' };
  for (const program of programs) {
    const { status, stdout } = spawnSync(program, run);
    assert.ok(status === 0 || status === 77, `${program}: ${status}\n${stdout}`); // 77: without external data
  }
  const kept = fs.readdirSync(folder);
  assert.ok(kept.length > 50, `${kept.length} files`);
  const wrong = [];
  for (const name of kept) {
    const file = path.join(folder, name, fs.readFileSync(path.join(folder, name, 'accepted'), 'utf8').trim());
    for (const error of await errorsOf(file)) wrong.push(`${name}${error}\n${fs.readFileSync(file, 'latin1').slice(0, 600)}`);
  }
  assert.equal(wrong.length, 0, `${wrong.length} errors in ${kept.length} files:\n${wrong.join('\n')}`);
});
