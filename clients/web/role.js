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

// For a thin line: `?rate=10&width=640` asks for no more pictures a second and none that is wider, `?coding=jpeg` for
// nothing else. What makes no sense asks for nothing.
export function wishedPictures({ search }) {
  const said = new URLSearchParams(search);
  const rate = Number(said.get('rate'));
  const width = Number(said.get('width'));
  return {
    coding: said.get('coding'),
    maxRate: rate > 0 && rate <= 1000 ? rate : undefined,
    maxWidth: Number.isInteger(width) && width > 0 && width <= 16384 ? width : undefined,
  };
}
