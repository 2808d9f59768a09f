// SPDX-License-Identifier: Apache-2.0
#include "services/export/mp4_writer.h"

#include <fmt/format.h>

#include <array>
#include <utility>

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/opt.h>
#include <libswscale/swscale.h>
}

namespace etude::exports {
namespace {

template <auto free>
struct Freer {
  template <class T>
  void operator()(T* pointer) const {
    free(&pointer);
  }
};
struct FormatCloser {
  void operator()(AVFormatContext* format) const {
    avio_closep(&format->pb);
    avformat_free_context(format);
  }
};
using Codec = std::unique_ptr<AVCodecContext, Freer<avcodec_free_context>>;
using Frame = std::unique_ptr<AVFrame, Freer<av_frame_free>>;
using Packet = std::unique_ptr<AVPacket, Freer<av_packet_free>>;
using Format = std::unique_ptr<AVFormatContext, FormatCloser>;
struct ScalerFreer {
  void operator()(SwsContext* scaler) const { sws_freeContext(scaler); }
};

std::string Words(int error) {
  std::array<char, AV_ERROR_MAX_STRING_SIZE> text{};
  av_strerror(error, text.data(), text.size());
  return text.data();
}

}  // namespace

struct Mp4Writer::Impl {
  Path path;
  VideoFormat format;
  Format file = {};
  Codec codec = {};
  Frame frame = {};
  Packet packet = {};
  std::unique_ptr<SwsContext, ScalerFreer> scaler = {};
  AVStream* stream = nullptr;  // of `file`
  std::int64_t frames = 0;
  std::uint64_t bytes = 0;

  Status Check(int result, const char* what) const {
    if (result >= 0) return {};
    const bool disk =
        result == AVERROR(ENOSPC) || result == AVERROR(EACCES) || result == AVERROR(ENOENT) || result == AVERROR(EROFS);
    return Fail(disk ? Code::kUnavailable : Code::kInternal,
                fmt::format("write the video '{}': {}: {}", path.string(), what, Words(result)));
  }

  Status OpenCodec();
  Status OpenFile();
  Status Encode(const AVFrame* picture);
};

// The encoder's output has no time of day in it and does not depend on how many cores there are.
Status Mp4Writer::Impl::OpenCodec() {
  const AVCodec* encoder = avcodec_find_encoder_by_name("libx264");
  if (encoder == nullptr)
    return Fail(Code::kUnavailable, fmt::format("write the video '{}': libavcodec has no libx264; install Debian's "
                                                "libavcodec (deploy/install)",
                                                path.string()));
  codec.reset(avcodec_alloc_context3(encoder));
  if (!codec) return Check(AVERROR(ENOMEM), "allocate the encoder");
  codec->width = format.width;
  codec->height = format.height;
  codec->pix_fmt = AV_PIX_FMT_YUV420P;
  codec->time_base = {1, format.fps};
  codec->framerate = {format.fps, 1};
  codec->gop_size = VideoFormat::kKeyFrameEvery;
  codec->max_b_frames = 0;
  codec->thread_count = 1;
  codec->color_range = AVCOL_RANGE_MPEG;
  codec->colorspace = AVCOL_SPC_SMPTE170M;  // what swscale converts to
  codec->flags |= AV_CODEC_FLAG_BITEXACT;
  if ((file->oformat->flags & AVFMT_GLOBALHEADER) != 0) codec->flags |= AV_CODEC_FLAG_GLOBAL_HEADER;
  av_opt_set(codec->priv_data, "preset", VideoFormat::kPreset, 0);
  av_opt_set_int(codec->priv_data, "crf", VideoFormat::kCrf, 0);
  av_opt_set_int(codec->priv_data, "forced-idr", 1, 0);
  return Check(avcodec_open2(codec.get(), encoder, nullptr), "open the encoder");
}

Status Mp4Writer::Impl::OpenFile() {
  AVFormatContext* made = nullptr;
  // the path, for the index is put in front in a second pass
  ETUDE_RETURN_IF_ERROR(Check(avformat_alloc_output_context2(&made, nullptr, "mp4", path.c_str()), "make a container"));
  file.reset(made);
  file->flags |= AVFMT_FLAG_BITEXACT;
  ETUDE_RETURN_IF_ERROR(OpenCodec());
  stream = avformat_new_stream(file.get(), nullptr);
  if (stream == nullptr) return Check(AVERROR(ENOMEM), "make a stream");
  stream->time_base = codec->time_base;
  stream->avg_frame_rate = codec->framerate;
  ETUDE_RETURN_IF_ERROR(Check(avcodec_parameters_from_context(stream->codecpar, codec.get()), "describe the stream"));
  ETUDE_RETURN_IF_ERROR(Check(avio_open(&file->pb, path.c_str(), AVIO_FLAG_WRITE), "create the file"));
  AVDictionary* options = nullptr;
  av_dict_set(&options, "movflags", "+faststart", 0);  // the index comes first, so that browsers need not load all
  const int result = avformat_write_header(file.get(), &options);
  av_dict_free(&options);
  return Check(result, "write the header");
}

// null: what the encoder still holds
Status Mp4Writer::Impl::Encode(const AVFrame* picture) {
  ETUDE_RETURN_IF_ERROR(Check(avcodec_send_frame(codec.get(), picture), "encode a picture"));
  for (;;) {
    const int result = avcodec_receive_packet(codec.get(), packet.get());
    if (result == AVERROR(EAGAIN) || result == AVERROR_EOF) return {};
    ETUDE_RETURN_IF_ERROR(Check(result, "encode a picture"));
    packet->duration = 1;
    packet->stream_index = stream->index;
    av_packet_rescale_ts(packet.get(), codec->time_base, stream->time_base);
    bytes += static_cast<std::uint64_t>(packet->size);
    ETUDE_RETURN_IF_ERROR(Check(av_interleaved_write_frame(file.get(), packet.get()), "write a picture"));
  }
}

Mp4Writer::Mp4Writer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Mp4Writer::Mp4Writer(Mp4Writer&&) noexcept = default;
Mp4Writer& Mp4Writer::operator=(Mp4Writer&&) noexcept = default;
Mp4Writer::~Mp4Writer() = default;

Result<Mp4Writer> Mp4Writer::Create(const Path& path, const VideoFormat& format) {
  if (format.width < 2 || format.height < 2 || format.width % 2 != 0 || format.height % 2 != 0 || format.fps < 1)
    return Fail(Code::kInvalidArgument,
                fmt::format("write the video '{}': {}x{} px at {} pictures/s; both sides must be even (H.264 halves "
                            "colours) and the rate at least 1",
                            path.string(), format.width, format.height, format.fps));
  av_log_set_level(AV_LOG_ERROR);
  auto impl = std::unique_ptr<Impl>(new Impl{path, format});
  ETUDE_RETURN_IF_ERROR(impl->OpenFile());
  impl->frame.reset(av_frame_alloc());
  impl->packet.reset(av_packet_alloc());
  impl->scaler.reset(sws_getContext(format.width, format.height, AV_PIX_FMT_RGB24, format.width, format.height,
                                    AV_PIX_FMT_YUV420P, SWS_BICUBIC | SWS_ACCURATE_RND | SWS_BITEXACT, nullptr, nullptr,
                                    nullptr));
  if (!impl->frame || !impl->packet || !impl->scaler) return Fail(Code::kInternal, "write a video: out of memory");
  impl->frame->format = AV_PIX_FMT_YUV420P;
  impl->frame->width = format.width;
  impl->frame->height = format.height;
  ETUDE_RETURN_IF_ERROR(impl->Check(av_frame_get_buffer(impl->frame.get(), 0), "allocate a picture"));
  return Mp4Writer(std::move(impl));
}

Status Mp4Writer::Add(std::span<const std::uint8_t> rgb, KeyFrame key) {
  Impl& impl = *impl_;
  const auto& format = impl.format;
  if (rgb.size() != 3ull * format.width * format.height)
    return Fail(Code::kInvalidArgument, fmt::format("write the video '{}': a picture of {} bytes is not {}x{} RGB",
                                                    impl.path.string(), rgb.size(), format.width, format.height));
  ETUDE_RETURN_IF_ERROR(impl.Check(av_frame_make_writable(impl.frame.get()), "take a picture"));
  const std::uint8_t* const planes[] = {rgb.data()};
  const int strides[] = {3 * format.width};
  sws_scale(impl.scaler.get(), planes, strides, 0, format.height, impl.frame->data, impl.frame->linesize);
  impl.frame->pict_type = key == KeyFrame::kForced ? AV_PICTURE_TYPE_I : AV_PICTURE_TYPE_NONE;
  impl.frame->pts = impl.frames++;
  return impl.Encode(impl.frame.get());
}

Status Mp4Writer::Finish() {
  ETUDE_RETURN_IF_ERROR(impl_->Encode(nullptr));
  ETUDE_RETURN_IF_ERROR(impl_->Check(av_write_trailer(impl_->file.get()), "write the index"));
  ETUDE_RETURN_IF_ERROR(impl_->Check(avio_closep(&impl_->file->pb), "close the file"));
  return SyncFile(impl_->path);
}

std::int64_t Mp4Writer::frames() const { return impl_->frames; }
std::uint64_t Mp4Writer::bytes() const { return impl_->bytes; }

}  // namespace etude::exports
