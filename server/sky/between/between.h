/* Skies between captured skies. */
#pragma once
