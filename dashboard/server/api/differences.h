// SPDX-License-Identifier: Apache-2.0
// How the settings of two runs, datasets or evaluations differ.
#pragma once

#include "dashboard/server/api/context.h"

namespace etude::api {

/// /diff?a=&b=: keys in which their configs or specs differ, the first of them with both values.
/// @error kNotFound: no such run, dataset or evaluation
Result<http::Answer> Diff(Context& context, const http::Request& request);

}  // namespace etude::api
