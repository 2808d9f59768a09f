// SPDX-License-Identifier: Apache-2.0
#include "services/video/mp4_writer.h"

#include <fmt/format.h>

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/imgutils.h>
#include <libavutil/opt.h>
#include <libswscale/swscale.h>
}

#include <array>
#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <utility>

#include "services/core/check.h"
#include "services/core/identity.h"

namespace etude::video {
namespace {

struct FreeCodec {
  void operator()(AVCodecContext* context) const { avcodec_free_context(&context); }
};
struct FreeFrame {
  void operator()(AVFrame* frame) const { av_frame_free(&frame); }
};
struct FreePacket {
  void operator()(AVPacket* packet) const { av_packet_free(&packet); }
};
struct FreeScaler {
  void operator()(SwsContext* context) const { sws_freeContext(context); }
};
struct FreeFormat {
  void operator()(AVFormatContext* context) const {
    if (context->pb) avio_closep(&context->pb);
    avformat_free_context(context);
  }
};

std::string Text(int code) {
  std::array<char, AV_ERROR_MAX_STRING_SIZE> buffer{};
  av_strerror(code, buffer.data(), buffer.size());
  return buffer.data();
}

// libav takes what stands before a colon for a protocol.
std::string UrlOf(const Path& path) { return "file:" + path.string(); }

tl::unexpected<Error> Refused(const Path& path, std::string_view what, int code) {
  return Fail(Code::kUnavailable, fmt::format("write the video '{}': {}: {}", path.string(), what, Text(code)));
}

const AVCodec* FindEncoder(Container container) {
  if (container == Container::kAnimatedWebp) return avcodec_find_encoder_by_name("libwebp_anim");
  if (const AVCodec* codec = avcodec_find_encoder_by_name("libx264")) return codec;
  if (const AVCodec* codec = avcodec_find_encoder(AV_CODEC_ID_H264)) return codec;
  return avcodec_find_encoder(AV_CODEC_ID_MPEG4);
}

void Configure(const Mp4Options& options, const AVFormatContext& format, AVCodecContext& codec) {
  codec.width = options.width;
  codec.height = options.height;
  codec.time_base = {options.rate.denominator, options.rate.numerator};
  codec.framerate = {options.rate.numerator, options.rate.denominator};
  codec.gop_size = options.key_frame_every;
  codec.max_b_frames = 0;
  codec.pix_fmt = AV_PIX_FMT_YUV420P;
  codec.thread_count = 1;  // small pictures: threads cost more than they give, and the machine is shared
  codec.bit_rate = 4'000'000;
  codec.color_range = AVCOL_RANGE_MPEG;
  codec.colorspace = AVCOL_SPC_SMPTE170M;  // what swscale converts to
  codec.flags |= AV_CODEC_FLAG_BITEXACT;
  if (format.oformat->flags & AVFMT_GLOBALHEADER) codec.flags |= AV_CODEC_FLAG_GLOBAL_HEADER;
  if (options.container == Container::kAnimatedWebp)
    av_opt_set_double(codec.priv_data, "quality", static_cast<double>(options.webp_quality), 0);
  if (std::string_view(codec.codec->name) != "libx264") return;
  codec.bit_rate = 0;
  av_opt_set(codec.priv_data, "preset", Mp4Options::kPreset, 0);
  av_opt_set_int(codec.priv_data, "crf", options.crf, 0);
  av_opt_set_int(codec.priv_data, "forced-idr", 1, 0);
}

}  // namespace

struct Mp4Writer::Impl {
  Path path;
  Path temporary;  // beside it, under a name of its own: others may write the same one; empty when it is in its place
  Mp4Options options;
  std::unique_ptr<AVFormatContext, FreeFormat> format;
  std::unique_ptr<AVCodecContext, FreeCodec> codec;
  std::unique_ptr<AVFrame, FreeFrame> frame;
  std::unique_ptr<AVPacket, FreePacket> packet;
  std::unique_ptr<SwsContext, FreeScaler> scaler;
  AVStream* stream = nullptr;  // of `format`
  std::int64_t pictures = 0;
  std::uint64_t bytes = 0;

  ~Impl() {
    std::error_code ignored;
    if (!temporary.empty()) std::filesystem::remove(temporary, ignored);
  }
  Status OpenEncoder();
  Status OpenFile();
  // what the encoder has ready goes to the file
  Status Drain();
};

Status Mp4Writer::Impl::OpenEncoder() {
  const AVCodec* encoder = FindEncoder(options.container);
  if (!encoder) {
    return Fail(Code::kUnavailable,
                fmt::format("write the video '{}': libav has no encoder of it ({})", path.string(),
                            options.container == Container::kMp4 ? "H.264 or MPEG-4" : "animated WebP"));
  }
  codec.reset(avcodec_alloc_context3(encoder));
  ETUDE_CHECK(codec != nullptr);
  Configure(options, *format, *codec);
  if (const int code = avcodec_open2(codec.get(), encoder, nullptr); code < 0)
    return Refused(path, fmt::format("open the encoder {}", encoder->name), code);
  frame.reset(av_frame_alloc());
  packet.reset(av_packet_alloc());
  ETUDE_CHECK(frame != nullptr && packet != nullptr);
  frame->format = codec->pix_fmt;
  frame->width = options.width;
  frame->height = options.height;
  if (const int code = av_frame_get_buffer(frame.get(), 0); code < 0) return Refused(path, "allocate a picture", code);
  scaler.reset(sws_getContext(options.width, options.height, AV_PIX_FMT_RGB24, options.width, options.height,
                              codec->pix_fmt, SWS_BICUBIC | SWS_ACCURATE_RND | SWS_BITEXACT, nullptr, nullptr,
                              nullptr));
  if (!scaler) return Fail(Code::kInternal, fmt::format("write the video '{}': no colour conversion", path.string()));
  return {};
}

Status Mp4Writer::Impl::OpenFile() {
  stream = avformat_new_stream(format.get(), nullptr);
  ETUDE_CHECK(stream != nullptr);
  if (const int code = avcodec_parameters_from_context(stream->codecpar, codec.get()); code < 0)
    return Refused(path, "describe the stream", code);
  stream->time_base = codec->time_base;
  stream->avg_frame_rate = codec->framerate;
  temporary = path.parent_path() / fmt::format(".{}.{}{}", path.stem().string(), NewId(), path.extension().string());
  // an index in front is made by opening it once more, by its URL
  const std::string url = UrlOf(temporary);
  av_freep(&format->url);
  format->url = av_strdup(url.c_str());
  ETUDE_CHECK(format->url != nullptr);
  if (const int code = avio_open(&format->pb, url.c_str(), AVIO_FLAG_WRITE); code < 0)
    return Refused(path, "open the file", code);
  AVDictionary* settings = nullptr;
  if (options.container == Container::kMp4) av_dict_set(&settings, "movflags", "+faststart", 0);
  if (options.container == Container::kAnimatedWebp) av_dict_set(&settings, "loop", "0", 0);  // for ever
  const int code = avformat_write_header(format.get(), &settings);
  av_dict_free(&settings);
  if (code < 0) return Refused(path, "write the header", code);
  return {};
}

Status Mp4Writer::Impl::Drain() {
  for (;;) {
    const int code = avcodec_receive_packet(codec.get(), packet.get());
    if (code == AVERROR(EAGAIN) || code == AVERROR_EOF) return {};
    if (code < 0) return Refused(path, "encode", code);
    packet->duration = 1;
    av_packet_rescale_ts(packet.get(), codec->time_base, stream->time_base);
    packet->stream_index = stream->index;
    bytes += static_cast<std::uint64_t>(packet->size);
    // it takes over the packet's data
    if (const int written = av_interleaved_write_frame(format.get(), packet.get()); written < 0)
      return Refused(path, "write", written);
  }
}

Result<Mp4Writer> Mp4Writer::Open(const Path& path, const Mp4Options& options) {
  if (options.width <= 0 || options.height <= 0 || options.width % 2 != 0 || options.height % 2 != 0 ||
      options.rate.numerator <= 0 || options.rate.denominator <= 0 || options.key_frame_every <= 0) {
    return Fail(
        Code::kInvalidArgument,
        fmt::format("write the video '{}': {}x{} px at {}/{} pictures a second; sides must be even and positive",
                    path.string(), options.width, options.height, options.rate.numerator, options.rate.denominator));
  }
  av_log_set_level(AV_LOG_ERROR);  // encoders tell their statistics otherwise
  auto impl = std::make_unique<Impl>();
  impl->path = path;
  impl->options = options;
  AVFormatContext* format = nullptr;
  const char* kind = options.container == Container::kMp4 ? "mp4" : "webp";
  if (const int code = avformat_alloc_output_context2(&format, nullptr, kind, nullptr); code < 0)
    return Refused(path, "open the format", code);
  impl->format.reset(format);
  impl->format->flags |= AVFMT_FLAG_BITEXACT;  // no library's version in the file
  ETUDE_RETURN_IF_ERROR(impl->OpenEncoder());
  ETUDE_RETURN_IF_ERROR(impl->OpenFile());
  return Mp4Writer(std::move(impl));
}

Mp4Writer::Mp4Writer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Mp4Writer::Mp4Writer(Mp4Writer&&) noexcept = default;
Mp4Writer& Mp4Writer::operator=(Mp4Writer&&) noexcept = default;
Mp4Writer::~Mp4Writer() = default;

Status Mp4Writer::Write(std::span<const std::uint8_t> rgb, KeyFrame key) {
  auto& impl = *impl_;
  const auto expected = static_cast<std::size_t>(impl.options.width) * impl.options.height * 3;
  if (rgb.size() != expected) {
    return Fail(Code::kInvalidArgument, fmt::format("write the video '{}': a picture of {} bytes instead of {}",
                                                    impl.path.string(), rgb.size(), expected));
  }
  // the encoder may still hold the last picture's memory
  if (const int code = av_frame_make_writable(impl.frame.get()); code < 0) return Refused(impl.path, "a picture", code);
  const std::uint8_t* source[] = {rgb.data()};
  const int stride[] = {impl.options.width * 3};
  sws_scale(impl.scaler.get(), source, stride, 0, impl.options.height, impl.frame->data, impl.frame->linesize);
  impl.frame->pict_type = key == KeyFrame::kForced ? AV_PICTURE_TYPE_I : AV_PICTURE_TYPE_NONE;
  impl.frame->pts = impl.pictures++;
  if (const int code = avcodec_send_frame(impl.codec.get(), impl.frame.get()); code < 0)
    return Refused(impl.path, "encode", code);
  return impl.Drain();
}

Status Mp4Writer::Finish() {
  auto& impl = *impl_;
  if (const int code = avcodec_send_frame(impl.codec.get(), nullptr); code < 0)
    return Refused(impl.path, "end the stream", code);
  ETUDE_RETURN_IF_ERROR(impl.Drain());
  if (const int code = av_write_trailer(impl.format.get()); code < 0)
    return Refused(impl.path, "write the index", code);
  if (const int code = avio_closep(&impl.format->pb); code < 0) return Refused(impl.path, "close the file", code);
  ETUDE_RETURN_IF_ERROR(SyncFile(impl.temporary));
  if (::rename(impl.temporary.c_str(), impl.path.c_str()) != 0)
    return Fail(ErrnoError("write the video", impl.path, errno));
  impl.temporary.clear();
  return SyncFolder(impl.path.parent_path());
}

std::int64_t Mp4Writer::pictures() const { return impl_->pictures; }
std::uint64_t Mp4Writer::bytes() const { return impl_->bytes; }

}  // namespace etude::video
