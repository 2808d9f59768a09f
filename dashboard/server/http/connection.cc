// SPDX-License-Identifier: Apache-2.0
// One connection: a request at a time, its answer, the next.
#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <boost/asio/dispatch.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/version.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <optional>
#include <utility>

#include "dashboard/server/http/answers.h"
#include "dashboard/server/http/encoding.h"
#include "dashboard/server/http/state.h"

namespace etude::http {
namespace {

namespace wire = beast::http;
using boost::system::error_code;

std::string Field(const BeastRequest& request, wire::field name) { return std::string(request[name]); }

// nullopt: its address makes no sense
std::optional<Request> FromWire(const BeastRequest& wire_request, const beast::tcp_stream& stream) {
  Request request;
  request.method = std::string(wire_request.method_string());
  const std::string target(wire_request.target());
  const auto question = target.find('?');
  auto path = SplitPath(std::string_view(target).substr(0, question));
  if (!path || !target.starts_with('/')) return std::nullopt;
  request.path = std::move(*path);
  if (question != std::string::npos) request.query = Query(std::string_view(target).substr(question + 1));
  request.host = Field(wire_request, wire::field::host);
  request.origin = Field(wire_request, wire::field::origin);
  request.authorization = Field(wire_request, wire::field::authorization);
  request.cookie = Field(wire_request, wire::field::cookie);
  request.content_type = Field(wire_request, wire::field::content_type);
  request.accept_encoding = Field(wire_request, wire::field::accept_encoding);
  request.if_none_match = Field(wire_request, wire::field::if_none_match);
  request.range = Field(wire_request, wire::field::range);
  request.if_range = Field(wire_request, wire::field::if_range);
  request.fetch_site = std::string(wire_request["Sec-Fetch-Site"]);
  request.body = wire_request.body();
  error_code ignored;
  const auto local = stream.socket().local_endpoint(ignored).address();
  // an IPv4 client of a socket for both; it names the address as it knows it
  request.local_address = local.is_v6() && local.to_v6().is_v4_mapped()
                              ? net::ip::make_address_v4(net::ip::v4_mapped, local.to_v6()).to_string()
                              : local.to_string();
  return request;
}

const char* CachingText(Caching caching) {
  switch (caching) {
    case Caching::kImmutable:
      return "private, max-age=31536000, immutable";
    case Caching::kNever:
      return "no-store";
    case Caching::kRevalidate:
      break;
  }
  return "private, no-cache";
}

// A file on its way out, a chunk at a time.
struct FileTransfer {
  wire::response<wire::buffer_body> response;
  wire::response_serializer<wire::buffer_body> serializer{response};
  std::shared_ptr<Descriptor> file;
  std::uint64_t offset = 0, left = 0;
  std::array<char, 128 * 1024> chunk{};
};

class Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(Server::State& state, beast::tcp_stream stream) : state_(state), stream_(std::move(stream)) {
    ++state_.open_connections;
  }
  ~Connection() { --state_.open_connections; }

  void Read() {
    parser_.emplace();
    parser_->body_limit(state_.options.request_bytes);
    parser_->header_limit(static_cast<std::uint32_t>(state_.options.header_bytes));
    stream_.expires_after(state_.options.read_time);
    wire::async_read(stream_, buffer_, *parser_,
                     [self = shared_from_this()](const error_code& error, std::size_t) { self->OnRead(error); });
  }

 private:
  void OnRead(const error_code& error);
  void Upgrade(Request request);
  void Dispatch(Request request);
  void Refuse(Answer answer);
  void Write(const Request& request, Answer answer);
  void WriteBody(Answer answer, bool head);
  void WriteFile(const Request& request, Answer answer, bool head);
  void WriteChunk(std::shared_ptr<FileTransfer> transfer);
  void OnWritten(const error_code& error);
  template <class Message>
  void SetHeaders(Message& message, const Answer& answer);
  template <class Message>
  void Send(std::shared_ptr<Message> message);
  void Close() {
    error_code ignored;
    stream_.socket().shutdown(net::ip::tcp::socket::shutdown_send, ignored);
  }
  void Drain();

  Server::State& state_;
  beast::tcp_stream stream_;
  beast::flat_buffer buffer_;
  std::optional<wire::request_parser<wire::string_body>> parser_;
  std::string host_;
  bool keep_alive_ = false;
  unsigned version_ = 11;
  bool refused_ = false;
  std::size_t drained_ = 0;   // bytes
  std::uint64_t served_ = 0;  // tells a late answer from the one that is waited for
};

void Connection::OnRead(const error_code& error) {
  if (error == wire::error::end_of_stream) return Close();
  if (error == wire::error::body_limit || error == wire::error::header_limit)
    return Refuse(Problem(413, "Too much", "the request is larger than this gateway takes"));
  if (error && error.category() == make_error_code(wire::error::bad_method).category() &&
      error != wire::error::partial_message)
    return Refuse(Problem(400, "The request is wrong", error.message()));
  if (error) return;  // gone, or too slow
  const BeastRequest& wire_request = parser_->get();
  keep_alive_ = wire_request.keep_alive();
  version_ = wire_request.version();
  auto request = FromWire(wire_request, stream_);
  if (!request) return Refuse(Problem(400, "The request is wrong", "its address cannot be read"));
  host_ = request->host;
  const std::string target(wire_request.target().substr(0, wire_request.target().find('?')));
  if (target == state_.options.socket_path && beast::websocket::is_upgrade(wire_request))
    return Upgrade(std::move(*request));
  Dispatch(std::move(*request));
}

void Connection::Upgrade(Request request) {
  if (auto refused = state_.service.CheckSocket(request)) return Refuse(std::move(*refused));
  // it goes on counting as a connection: this object lives until the socket ends
  StartSocket(state_, std::move(stream_), parser_->release(), request, [self = shared_from_this()] {});
}

void Connection::Dispatch(Request request) {
  const std::uint64_t ticket = ++served_;
  stream_.expires_never();
  auto timer = std::make_shared<net::steady_timer>(state_.network, state_.options.handle_time);
  const auto given_up = std::make_shared<std::atomic<bool>>(false);
  timer->async_wait([self = shared_from_this(), ticket, given_up](const error_code& error) {
    if (error || self->served_ != ticket) return;
    *given_up = true;
    self->Refuse(Problem(504, "Took too long", "the answer was not ready in time", "ask for less, or try again"));
  });
  auto shared = std::make_shared<Request>(std::move(request));
  const Lane lane = state_.service.LaneOf(*shared);
  state_.Post(lane, [self = shared_from_this(), shared, timer, ticket, given_up] {
    if (*given_up) return;  // nobody waits for it any more
    auto answer = std::make_shared<Answer>(self->state_.service.Handle(*shared));
    net::post(self->state_.network, [self, shared, timer, ticket, answer] {
      timer->cancel();
      if (self->served_ == ticket) self->Write(*shared, std::move(*answer));
    });
  });
}

void Connection::Refuse(Answer answer) {
  ++served_;
  keep_alive_ = false;
  refused_ = true;
  Write(Request{}, std::move(answer));
}

// Of a request that was refused the rest may still come. A connection that is closed with bytes unread is reset, and
// the client never sees why: what comes is passed over, for a short while.
void Connection::Drain() {
  constexpr std::size_t kMost = 1 << 20;
  constexpr std::chrono::seconds kPatience{2};
  stream_.expires_after(kPatience);
  buffer_.consume(buffer_.size());
  stream_.async_read_some(buffer_.prepare(16 * 1024),
                          [self = shared_from_this()](const error_code& error, std::size_t size) {
                            self->drained_ += size;
                            if (!error && self->drained_ < kMost) self->Drain();
                          });
}

template <class Message>
void Connection::SetHeaders(Message& message, const Answer& answer) {
  message.version(version_);
  message.keep_alive(keep_alive_);
  message.set(wire::field::server, "etude-gateway");
  message.set(wire::field::cache_control, CachingText(answer.caching));
  if (!answer.content_type.empty()) message.set(wire::field::content_type, answer.content_type);
  if (!answer.content_encoding.empty()) message.set(wire::field::content_encoding, answer.content_encoding);
  if (!answer.etag.empty()) message.set(wire::field::etag, "\"" + answer.etag + "\"");
  message.set(wire::field::vary, "Accept-Encoding");
  for (const auto& [name, value] : SecurityHeaders(host_)) message.set(name, value);
  for (const auto& [name, value] : answer.headers) message.insert(name, value);
}

void Connection::Write(const Request& request, Answer answer) {
  ++served_;
  const bool head = request.method == "HEAD";
  if (answer.file) return WriteFile(request, std::move(answer), head);
  WriteBody(std::move(answer), head);
}

template <class Message>
void Connection::Send(std::shared_ptr<Message> message) {
  stream_.expires_after(state_.options.write_time);
  wire::async_write(stream_, *message, [self = shared_from_this(), message](const error_code& error, std::size_t) {
    self->OnWritten(error);
  });
}

void Connection::WriteBody(Answer answer, bool head) {
  if (head) {
    auto message =
        std::make_shared<wire::response<wire::empty_body>>(static_cast<wire::status>(answer.status), version_);
    SetHeaders(*message, answer);
    message->content_length(answer.body.size());
    return Send(message);
  }
  auto message =
      std::make_shared<wire::response<wire::string_body>>(static_cast<wire::status>(answer.status), version_);
  SetHeaders(*message, answer);
  message->body() = std::move(answer.body);
  message->prepare_payload();
  Send(message);
}

void Connection::WriteFile(const Request& request, Answer answer, bool head) {
  const FileBody file = *answer.file;
  answer.headers.emplace_back("Accept-Ranges", "bytes");
  // a part is of use only with the rest of the same file: of another one all of it is sent (RFC 9110, 13.1.5)
  const bool same = request.if_range.empty() || (!answer.etag.empty() && request.if_range == "\"" + answer.etag + "\"");
  const RangeRequest range = ParseRange(same ? request.range : "", file.size);
  if (range.kind == RangeKind::kUnsatisfiable) {
    Answer refused = Problem(416, "No such range", fmt::format("the file has {} bytes", file.size));
    refused.headers.emplace_back("Content-Range", fmt::format("bytes */{}", file.size));
    return WriteBody(std::move(refused), head);
  }
  auto transfer = std::make_shared<FileTransfer>();
  transfer->file = file.file;
  transfer->left = file.size;
  if (range.kind == RangeKind::kPart) {
    answer.status = 206;
    transfer->offset = range.range.first;
    transfer->left = range.range.size();
    answer.headers.emplace_back("Content-Range",
                                fmt::format("bytes {}-{}/{}", range.range.first, range.range.last, file.size));
  }
  auto& response = transfer->response;
  response.result(static_cast<wire::status>(answer.status));
  SetHeaders(response, answer);
  response.content_length(transfer->left);
  response.body().data = nullptr;
  response.body().more = !head && transfer->left > 0;
  if (head) transfer->left = 0;
  stream_.expires_after(state_.options.write_time);
  wire::async_write_header(stream_, transfer->serializer,
                           [self = shared_from_this(), transfer](const error_code& error, std::size_t) {
                             if (error || transfer->left == 0) return self->OnWritten(error);
                             self->WriteChunk(transfer);
                           });
}

void Connection::WriteChunk(std::shared_ptr<FileTransfer> transfer) {
  const auto wanted = std::min<std::uint64_t>(transfer->left, transfer->chunk.size());
  const auto got = ::pread(transfer->file->get(), transfer->chunk.data(), wanted, static_cast<off_t>(transfer->offset));
  if (got <= 0) {  // cut while it was sent: the client must see that it is not whole
    stream_.close();
    return;
  }
  transfer->offset += static_cast<std::uint64_t>(got);
  transfer->left -= static_cast<std::uint64_t>(got);
  auto& body = transfer->response.body();
  body.data = transfer->chunk.data();
  body.size = static_cast<std::size_t>(got);
  body.more = transfer->left > 0;
  stream_.expires_after(state_.options.write_time);
  wire::async_write(stream_, transfer->serializer,
                    [self = shared_from_this(), transfer](error_code error, std::size_t) {
                      // the serializer asks for the next chunk in this way
                      if (error == wire::error::need_buffer) error = {};
                      if (error || transfer->left == 0) return self->OnWritten(error);
                      self->WriteChunk(transfer);
                    });
}

void Connection::OnWritten(const error_code& error) {
  if (error) return;
  if (keep_alive_) return Read();
  Close();
  if (refused_) Drain();
}

}  // namespace

void StartConnection(Server::State& state, beast::tcp_stream stream) {
  std::make_shared<Connection>(state, std::move(stream))->Read();
}

}  // namespace etude::http
