// As what the page connects. `#role=viewer` or `#role=controller` in the address says it; else whoever opens the page on
// the machine that runs the server is its controller. `#token=...` is shown to the server, which gets it in `hello` only:
// a fragment is sent in no request and stands in no log.

const LOOPBACK = /^(localhost|127(\.\d+){3}|\[::1\])$/;

export function wishedRole({ hash, hostname }) {
  const said = new URLSearchParams(hash.replace(/^#/, ''));
  const asked = said.get('role');
  const role = asked === 'viewer' || asked === 'controller' ? asked : LOOPBACK.test(hostname) ? 'controller' : 'viewer';
  const token = said.get('token') || undefined;
  return { role, token };
}
