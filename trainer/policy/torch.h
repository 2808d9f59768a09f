// SPDX-License-Identifier: Apache-2.0
// What the project uses of libtorch's C++ API. <torch/torch.h> would bring its data loaders, all of its modules and its
// optimizers into every source as well: half as much time again for each, precompiled or not.
#pragma once

#include <torch/autograd.h>
#include <torch/cuda.h>
#include <torch/nn/functional/linear.h>
#include <torch/nn/init.h>
#include <torch/nn/module.h>
#include <torch/nn/modules/conv.h>
#include <torch/nn/modules/linear.h>
#include <torch/types.h>
#include <torch/utils.h>
