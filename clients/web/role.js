// The role in which the page connects: `#role=viewer` or `#role=controller` in the address; by default controller on the
// server's own machine, else viewer. `#token=...` is sent in `hello` only: browsers never send a fragment in a request, so it
// appears in no log.

const LOOPBACK = /^(localhost|127(\.\d+){3}|\[::1\])$/;

export function wishedRole({ hash, hostname }) {
  const said = new URLSearchParams(hash.replace(/^#/, ''));
  const asked = said.get('role');
  const role = asked === 'viewer' || asked === 'controller' ? asked : LOOPBACK.test(hostname) ? 'controller' : 'viewer';
  const token = said.get('token') || undefined;
  return { role, token };
}

// For slow connections: `?rate=10&width=640` limits frame rate and width, `?coding=jpeg` forces JPEG. Invalid values are
// ignored.
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
