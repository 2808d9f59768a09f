// SPDX-License-Identifier: Apache-2.0
// One WebSocket: one write in flight, a slot for what waits of each channel, the newest wins.
#include <algorithm>
#include <atomic>
#include <boost/asio/post.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket.hpp>
#include <deque>
#include <mutex>
#include <utility>

#include "dashboard/server/http/state.h"
#include "services/core/log.h"
#include "services/core/thread_annotations.h"

namespace etude::http {
namespace {

namespace websocket = beast::websocket;
using boost::system::error_code;

constexpr std::size_t kWaitingBytes = 4 << 20;
constexpr std::size_t kMessageBytes = 16 * 1024;  // of what a browser says
constexpr std::chrono::seconds kSlowWrite{2}, kStuckWrite{10};
constexpr int kMostSlowdown = 16;

class SocketSession : public Socket, public std::enable_shared_from_this<SocketSession> {
 public:
  SocketSession(Server::State& state, beast::tcp_stream stream, std::function<void()> ended)
      : state_(state), stream_(std::move(stream)), watch_(state.network), ended_(std::move(ended)) {}

  void Start(BeastRequest upgrade, const Request& request);

  void Send(const std::string& slot, std::string text) override;
  bool Waits(const std::string& slot) const override;
  int slowdown() const override { return slowdown_; }
  std::size_t waiting_bytes() const override {
    MutexLock lock(mutex_);
    return waiting_bytes_;
  }
  void Close() override {
    net::post(state_.network, [self = shared_from_this()] { self->End(); });
  }

 private:
  struct Message {
    std::string slot, text;
  };
  void Read();
  void WriteNext();
  void OnWritten(const error_code& error);
  void Watch();
  void End();

  Server::State& state_;
  // network thread only
  websocket::stream<beast::tcp_stream> stream_;
  net::steady_timer watch_;
  beast::flat_buffer buffer_;
  std::shared_ptr<SocketClient> client_;
  std::function<void()> ended_;
  bool writing_ = false, over_ = false;
  std::string in_flight_;
  std::chrono::steady_clock::time_point write_began_{};

  std::atomic<int> slowdown_{1};
  mutable Mutex mutex_;
  std::deque<Message> waiting_ ETUDE_GUARDED_BY(mutex_);
  std::size_t waiting_bytes_ ETUDE_GUARDED_BY(mutex_) = 0;
  bool said_ ETUDE_GUARDED_BY(mutex_) = false;  // that something is too large ever to be sent
};

void SocketSession::Start(BeastRequest upgrade, const Request& request) {
  beast::get_lowest_layer(stream_).expires_never();
  stream_.set_option(websocket::stream_base::timeout::suggested(beast::role_type::server));
  stream_.set_option(websocket::stream_base::decorator(
      [](websocket::response_type& response) { response.set(beast::http::field::server, "etude-gateway"); }));
  stream_.read_message_max(kMessageBytes);
  auto shared = std::make_shared<BeastRequest>(std::move(upgrade));
  stream_.async_accept(*shared, [self = shared_from_this(), shared, request](const error_code& error) {
    if (error) return self->End();
    self->client_ = self->state_.sockets(request, self);
    if (!self->client_) return self->End();
    self->Watch();
    self->Read();
  });
}

void SocketSession::Read() {
  stream_.async_read(buffer_, [self = shared_from_this()](const error_code& error, std::size_t) {
    if (error || self->over_) return self->End();
    if (self->stream_.got_text()) self->client_->OnText(beast::buffers_to_string(self->buffer_.data()));
    self->buffer_.consume(self->buffer_.size());
    self->Read();
  });
}

void SocketSession::Send(const std::string& slot, std::string text) {
  {
    MutexLock lock(mutex_);
    const auto found = std::ranges::find(waiting_, slot, &Message::slot);
    const std::size_t replaced = found == waiting_.end() ? 0 : found->text.size();
    if (waiting_bytes_ - replaced + text.size() > kWaitingBytes) {
      if (text.size() > kWaitingBytes && !std::exchange(said_, true))
        Log().warn("live '{}': a snapshot of {} bytes is never sent, the bound is {}", slot.substr(0, 100), text.size(),
                   kWaitingBytes);
      return;
    }
    waiting_bytes_ += text.size() - replaced;
    if (found == waiting_.end())
      waiting_.push_back({slot, std::move(text)});
    else
      found->text = std::move(text);
  }
  net::post(state_.network, [self = shared_from_this()] { self->WriteNext(); });
}

bool SocketSession::Waits(const std::string& slot) const {
  MutexLock lock(mutex_);
  return std::ranges::find(waiting_, slot, &Message::slot) != waiting_.end();
}

// Beast allows one write at a time.
void SocketSession::WriteNext() {
  if (writing_ || over_) return;
  {
    MutexLock lock(mutex_);
    if (waiting_.empty()) return;
    in_flight_ = std::move(waiting_.front().text);
    waiting_.pop_front();
    waiting_bytes_ -= in_flight_.size();
  }
  writing_ = true;
  write_began_ = std::chrono::steady_clock::now();
  stream_.text(true);
  stream_.async_write(net::buffer(in_flight_),
                      [self = shared_from_this()](const error_code& error, std::size_t) { self->OnWritten(error); });
}

void SocketSession::OnWritten(const error_code& error) {
  writing_ = false;
  if (error || over_) return End();
  const bool slow = std::chrono::steady_clock::now() - write_began_ > kSlowWrite;
  const int now = slowdown_;
  slowdown_ = slow ? std::min(kMostSlowdown, now * 2) : std::max(1, now / 2);
  WriteNext();
}

// A browser that takes nothing for so long is gone, or must ask anew: a close frame could not pass the write that is
// stuck, so the connection is cut.
void SocketSession::Watch() {
  watch_.expires_after(std::chrono::seconds(1));
  watch_.async_wait([self = shared_from_this()](const error_code& error) {
    if (error || self->over_) return;
    if (self->writing_ && std::chrono::steady_clock::now() - self->write_began_ > kStuckWrite) return self->End();
    self->Watch();
  });
}

void SocketSession::End() {
  if (std::exchange(over_, true)) return;
  watch_.cancel();
  beast::get_lowest_layer(stream_).close();
  if (client_) client_->OnClosed();
  client_.reset();
  if (ended_) ended_();
  ended_ = nullptr;
  MutexLock lock(mutex_);
  waiting_.clear();
  waiting_bytes_ = 0;
}

}  // namespace

void StartSocket(Server::State& state, beast::tcp_stream stream, BeastRequest upgrade, const Request& request,
                 std::function<void()> ended) {
  std::make_shared<SocketSession>(state, std::move(stream), std::move(ended))->Start(std::move(upgrade), request);
}

}  // namespace etude::http
