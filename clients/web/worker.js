// The player in a worker, so that a busy page delays neither messages nor decoding.
import { Player } from './js/player.js';

const player = new Player((event, transfer = []) => self.postMessage(event, transfer));
self.onmessage = (event) => player.command(event.data);
