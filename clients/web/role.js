// The role in which the page connects: `#role=viewer` or `#role=controller` in the address; by default controller on the
// server's own machine, else viewer. `#token=...` is sent in `hello` only: browsers never send a fragment in a request, so it
// appears in no log. Without one in the address, the page uses what was typed into it, kept for this tab.

const LOOPBACK = /^(localhost|127(\.\d+){3}|\[::1\])$/;

const KEPT = 'relightd-access'; // in sessionStorage, which a frame of another site may not have

export function keptAccess() {
  try {
    return JSON.parse(sessionStorage.getItem(KEPT)) ?? {};
  } catch {
    return {};
  }
}

export function keepAccess(access) {
  try {
    sessionStorage.setItem(KEPT, JSON.stringify(access));
  } catch {
    // it lasts as long as the page
  }
}

export function wishedRole({ hash, hostname }, kept = keptAccess()) {
  const said = new URLSearchParams(hash.replace(/^#/, ''));
  const asked = said.get('role');
  const role = asked === 'viewer' || asked === 'controller' ? asked : LOOPBACK.test(hostname) ? 'controller' : 'viewer';
  const token = said.get('token') || undefined;
  return token || !kept.token ? { role, token } : { role: asked ?? kept.role ?? role, token: kept.token };
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

// `?from=hls`: watch the published stream instead of connecting to relightd.
export const wishedHls = ({ search }) => new URLSearchParams(search).get('from') === 'hls';
