// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/http/answers.h"

#include <cmath>

namespace etude::http {
namespace {

constexpr std::uint64_t kLargestExact = 1ull << 53;

struct Kind {
  int status;
  const char* title;
};

Kind KindOf(Code code) {
  switch (code) {
    case Code::kInvalidArgument:
      return {400, "The request is wrong"};
    case Code::kNotFound:
      return {404, "Not found"};
    case Code::kUnavailable:
      return {503, "Not available now"};
    case Code::kTimeout:
      return {504, "Took too long"};
    case Code::kExhausted:
      return {413, "Too much"};
    case Code::kCorrupt:
      return {422, "The file is damaged"};
    case Code::kInternal:
      break;
  }
  return {500, "Failed"};
}

}  // namespace

OrderedJson ForBrowsers(const OrderedJson& json) {
  if (json.is_object()) {
    OrderedJson object = OrderedJson::object();
    for (const auto& [key, value] : json.items())
      object[key] = key == "seed" && value.is_number_integer() ? OrderedJson(value.dump()) : ForBrowsers(value);
    return object;
  }
  if (json.is_array()) {
    OrderedJson array = OrderedJson::array();
    for (const auto& value : json) array.push_back(ForBrowsers(value));
    return array;
  }
  if (json.is_number_unsigned() && json.get<std::uint64_t>() > kLargestExact) return json.dump();
  if (json.is_number_integer() && !json.is_number_unsigned() &&
      json.get<std::int64_t>() < -static_cast<std::int64_t>(kLargestExact))
    return json.dump();
  if (json.is_number_float() && !std::isfinite(json.get<double>())) return nullptr;
  return json;
}

Answer JsonAnswer(const OrderedJson& json, int status) {
  Answer answer;
  answer.status = status;
  // names on disk and on the bus may hold bytes that are not UTF-8
  answer.body = JsonText(json);
  return answer;
}

Answer BytesAnswer(std::string bytes, std::string content_type, Caching caching) {
  Answer answer;
  answer.body = std::move(bytes);
  answer.content_type = std::move(content_type);
  answer.caching = caching;
  return answer;
}

Answer Problem(int status, std::string_view title, std::string_view detail, std::string_view hint) {
  OrderedJson json{{"title", title}, {"status", status}, {"detail", detail}};
  if (!hint.empty()) json["hint"] = hint;
  Answer answer = JsonAnswer(json, status);
  answer.content_type = "application/problem+json";
  answer.caching = Caching::kNever;
  return answer;
}

Answer ProblemOf(const Error& error) {
  const Kind kind = KindOf(error.code);
  return Problem(kind.status, kind.title, error.message);
}

}  // namespace etude::http
