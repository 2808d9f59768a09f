// SPDX-License-Identifier: Apache-2.0
// The ten built-in drawings. Each draws its shape, proportions, colours and details from the random numbers.
#pragma once

#include "worker/synthesis/pattern.h"

namespace etude::synthesis {

Drawing DrawApple(Rng& rng);
Drawing DrawAvocado(Rng& rng);  ///< halved, with its stone
Drawing DrawOrange(Rng& rng);
Drawing DrawStrawberry(Rng& rng);
Drawing DrawLemon(Rng& rng);
Drawing DrawPear(Rng& rng);
Drawing DrawDonut(Rng& rng);
Drawing DrawSourdough(Rng& rng);
Drawing DrawHamburger(Rng& rng);
Drawing DrawMug(Rng& rng);

}  // namespace etude::synthesis
