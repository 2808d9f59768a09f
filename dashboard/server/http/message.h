// SPDX-License-Identifier: Apache-2.0
// A request and its answer as plain values: what handlers see. Beast stays behind server.h.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "services/core/descriptor.h"
#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::http {

/// The parameters behind '?', decoded, in the order in which they came.
class Query {
 public:
  Query() = default;
  /// "a=1&b=x%20y"; what does not decode is kept as it is.
  explicit Query(std::string_view text);

  std::optional<std::string> Get(std::string_view key) const;  ///< the first one
  std::vector<std::string> All(std::string_view key) const;
  /// A number within bounds, `fallback` where there is none. @error kInvalidArgument: names the key and the bounds
  Result<std::int64_t> Integer(std::string_view key, std::int64_t fallback, std::int64_t low, std::int64_t high) const;

 private:
  std::vector<std::pair<std::string, std::string>> items_;
};

struct Request {
  std::string method = "GET";
  std::vector<std::string> path;  ///< decoded segments: "/a/b%20c" is {"a", "b c"}
  Query query;
  std::string host, origin, authorization, cookie, content_type, accept_encoding, if_none_match, range, if_range;
  std::string fetch_site;     ///< where a browser says that the page is that asks: "same-origin", "cross-site", ...
  std::string local_address;  ///< of the connection, "127.0.0.1"
  std::string body;
  bool authorized = false;  ///< it brought the token
  /// What stood for {name} in the route.
  std::map<std::string, std::string> parameters;

  std::string Parameter(const std::string& name) const {
    const auto found = parameters.find(name);
    return found == parameters.end() ? "" : found->second;
  }
  /// A {name} that is a number. @error kNotFound: it is none, so that there is no such thing
  Result<std::uint64_t> Index(const std::string& name) const;
};

/// "/a//b%2fc" -> {"a", "b/c"}. Nothing when an escape is broken or a segment is "..", or has a NUL.
std::optional<std::vector<std::string>> SplitPath(std::string_view path);
/// %41 and, in queries, '+'. Nothing when an escape is broken.
std::optional<std::string> PercentDecoded(std::string_view text, bool plus_is_space = false);

/// An open file that goes out as it is; closed with its last owner.
struct FileBody {
  std::shared_ptr<Descriptor> file;
  std::uint64_t size = 0;
};

enum class Caching : std::uint8_t {
  kRevalidate,  ///< no-cache: asked again each time, answered by 304 where nothing changed
  kImmutable,   ///< what its address names never changes
  kNever,       ///< no-store
};

struct Answer {
  int status = 200;
  std::string content_type = "application/json";
  std::string body;
  std::optional<FileBody> file;  ///< instead of `body`
  std::string content_encoding;  ///< `body` is encoded already; "": it is not
  std::string etag;              ///< without quotes; "": made of the body
  Caching caching = Caching::kRevalidate;
  std::vector<std::pair<std::string, std::string>> headers;
};

}  // namespace etude::http
