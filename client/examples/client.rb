# A client in Ruby, written from proto/PROTOCOL.md alone; comments name its sections.
#   ruby client.rb ENDPOINT               steps HalfCheetah a thousand times
#   ruby client.rb ENDPOINT CASES.json    plays the table of tests/conformance
# On Debian: apt install ruby ruby-google-protobuf ruby-ffi-rzmq protobuf-compiler
%w[ffi-rzmq google/protobuf json securerandom socket tmpdir].each { |library| require library }
PROTO = File.expand_path("../../proto", __dir__)
Dir.mktmpdir do |folder|
  system("protoc", "-I#{PROTO}", "--ruby_out=#{folder}", "#{PROTO}/b4mrl.proto") || abort("protoc failed")
  require "#{folder}/b4mrl_pb"
end
Pb, Failure = B4mrl::Pb, Class.new(StandardError)
# Section 3: how the elements of an array are packed, and the bytes of one.
PACKING = { FLOAT32: ["e", 4], FLOAT64: ["E", 8], INT32: ["l<", 4], INT64: ["q<", 8],
            UINT8: ["C", 1], UINT32: ["L<", 4], UINT64: ["Q<", 8] }.freeze
def pack(dtype, values) = values.pack("#{PACKING.fetch(dtype, ["C"])[0]}*")

# A reply with its arrays: name => [dtype, shape, bytes].
Reply = Struct.new(:envelope, :arrays) do
  def id = envelope.request_id
  def code = envelope.status&.code || 0
  # All of it but what a repeated answer may have anew: its id and its times.
  def content = [Pb::Reply.decode(Pb::Reply.encode(envelope)).tap do |copy|
    copy.timing, copy.request_id = nil, 0
    copy.arrays.clear
  end, arrays]
end

# The frames of a request (section 2). Arrays: [name, dtype, shape, bytes], and perhaps an offset.
def frames_of(fields, id, token, arrays)
  request = Pb::Request.decode_json({ "protocol_version" => 1 }.merge(fields).to_json)
  request.session_token, request.request_id = token, id
  payload = String.new(encoding: Encoding::BINARY)
  arrays.each do |name, dtype, shape, bytes, offset|
    payload << "\0" * (-payload.bytesize % 64)
    request.arrays << Pb::Array.new(name: name, dtype: dtype, shape: shape, offset: offset || payload.bytesize)
    payload << bytes
  end
  [Pb::Request.encode(request)] + (payload.empty? ? [] : [payload])
end

# Section 3: an array lies within the payload.
def read(entry, payload)
  bytes = entry.shape.reduce(PACKING.fetch(entry.dtype)[1], :*)
  sound = (entry.offset % 64).zero? && entry.offset + bytes <= payload.bytesize
  sound ? [entry.dtype, entry.shape.to_a, payload.byteslice(entry.offset, bytes)] : raise(Failure, entry.name)
end

# The processes of a server, each behind a DEALER (section 1).
class Server
  def initialize(endpoint)
    @endpoint, @context, @poller = endpoint, ZMQ::Context.new, ZMQ::Poller.new
    @sockets = Hash.new { |all, address| all[address] = connect(address) }
  end

  def connect(address)
    socket = @context.socket(ZMQ::DEALER)
    { ZMQ::LINGER => 0, ZMQ::MAXMSGSIZE => 67_108_864 }.each { |option, value| socket.setsockopt(option, value) }
    socket.connect(address).zero? || abort("cannot connect to #{address}")
    socket.tap { @poller.register_readable(socket) }
  end

  def gateway = @sockets[@endpoint]
  def behind(port) # the gateway relays what is for a port that cannot be reached
    return port.ipc.empty? ? gateway : @sockets["ipc://#{port.ipc}"] if @endpoint.start_with?("ipc://")
    return gateway if port.tcp.zero? || @relayed
    host = @endpoint[%r{\Atcp://(.*):\d+\z}, 1]
    Socket.tcp(host, port.tcp, connect_timeout: 1, &:close)
    @sockets["tcp://#{host}:#{port.tcp}"]
  rescue SystemCallError => e
    warn "#{e.message}; requests go through the gateway, which is slower"
    @relayed = true
    gateway
  end

  def replies(seconds) # those that have come, or come within this time
    @poller.poll((seconds * 1000).ceil)
    @poller.readables.filter_map do |socket|
      frames = []
      next if socket.recv_strings(frames, ZMQ::DONTWAIT) == -1
      envelope = Pb::Reply.decode(frames[0])
      Reply.new(envelope, envelope.arrays.to_h { |entry| [entry.name, read(entry, frames[1] || "")] })
    end
  end
end

# What is true of every reply (sections 2 and 6), and what a step expects of this one.
def check(step, reply, id, labels)
  want, status = step.fetch("expect", {}), reply.envelope.status
  verify = ->(truth, text) { truth || raise(Failure, "#{text} (code #{reply.code}: #{status&.message})") }
  verify[reply.envelope.protocol_version == 1 && reply.id == id, "version or id"]
  verify[[want.fetch("code", 0)].flatten.include?(reply.code), "expected code #{want.fetch("code", 0)}"]
  want.fetch("text", []).each { |word| verify[status.message.include?(word), "no '#{word}'"] }
  unless reply.code.zero?
    verify[status.message.match?(/\A[ -~]+\z/) && reply.arrays.empty? && !reply.envelope.payload, "an error's form"]
    return verify[status.recoverable == [4, 7, 8, 9].include?(reply.code), "recoverable"]
  end
  kind = step["request"]&.keys&.find { |key| step["request"][key].is_a?(Hash) }
  verify[kind.nil? || reply.envelope.payload.to_s == kind, "payload #{reply.envelope.payload}"]
  want.fetch("arrays", []).each do |name, dtype, shape, values|
    got = reply.arrays.fetch(name) { raise Failure, "no array #{name}" }
    verify[got[0, 2] == [dtype.to_sym, shape], "array #{name}: #{got[0, 2]}"]
    verify[values.nil? || got[2] == pack(got[0], values), "values of #{name}"]
  end
  verify[(want.fetch("no_arrays", []) & reply.arrays.keys).empty?, "unexpected arrays"]
  twin = want["same_as"]
  verify[twin.nil? || labels.fetch(twin).content == reply.content, "differs from #{twin}"]
  json = Pb::Reply.encode_json(reply.envelope, emit_defaults: true, preserve_proto_fieldnames: true)
  verify[contains(JSON.parse(json), want.fetch("reply", {})), "reply #{json}"]
end

def contains(whole, part)
  return part.all? { |key, value| whole.is_a?(Hash) && contains(whole[key], value) } if part.is_a?(Hash)
  return whole.size == part.size && whole.zip(part).all? { |pair| contains(*pair) } if part.is_a?(Array)
  whole == part
end

# Sends steps in the form of tests/conformance/README.md and checks what comes back.
class Player
  attr_reader :labels
  @@id = 1000

  def initialize(server, dataset = nil)
    @server, @dataset, @labels, @due, @workers = server, dataset, {}, {}, {}
    @tokens = Hash.new { |all, name| all[name] = SecureRandom.bytes(16) }
  end

  def play(steps)
    steps.each { |step| post(step) && (collect unless step["later"]) }
  end

  def post(step)
    worker = @workers.fetch(step.fetch("session", "a"), @workers.values.last)
    to = { "gateway" => @server.gateway, "dataset" => @dataset }.fetch(step.fetch("to", "worker"), worker)
    if step["raw"]
      frames = step["raw"].map { |frame| [frame].flatten.then { |hex, times| [hex].pack("H*") * (times || 1) } }
      to.send_strings(frames, ZMQ::DONTWAIT)
      return @due[step.fetch("id", 0)] = [step]
    end
    token = step["token"] ? [step["token"]].pack("H*") : @tokens[step.fetch("session", "a")]
    arrays = step.fetch("arrays", []).map { |entry| bytes_of(*entry) }
    step.fetch("times", 1).times do
      @due[@@id += 1] = [step, to, frames_of(step["request"], @@id, token, arrays)]
      to.send_strings(@due[@@id][2], ZMQ::DONTWAIT)
    end
  end

  def bytes_of(name, dtype, shape, values = nil, offset = nil)
    return [name, *@labels[shape].arrays[name]] if shape.is_a?(String)
    dtype = dtype.is_a?(String) ? dtype.to_sym : dtype
    shape = shape.map(&:to_i)
    values = [values] * shape.reduce(1, :*) unless values.is_a?(Array)
    special = { "nan" => Float::NAN, "inf" => Float::INFINITY }
    numbers = values.map { |value| special[value] || (value.is_a?(String) ? value.to_i : value) }
    [name, dtype, shape, pack(dtype, numbers), offset&.to_i]
  end

  def collect # waits for all replies; sends again what has none after an eighth of 10 s (sections 4 and 5)
    got, waits = {}, 0
    until (late = @due.reject { |id, _| got.key?(id) }).empty?
      replies = @server.replies(1.25).each { |reply| got[reply.id] = reply }
      next unless replies.empty?
      late.each_value { |_, to, frames| to&.send_strings(frames, ZMQ::DONTWAIT) }
      (waits += 1) < 40 || raise(Failure, "no reply")
    end
    @due.each do |id, (step)|
      check(step, got[id], id, @labels)
      @labels[step["label"]] = got[id] if step["label"]
      @workers[step.fetch("session", "a")] = @server.behind(got[id].envelope.open.port) if got[id].envelope.open
    end
    @due.group_by { |_, (step)| step }.each do |step, sent|
      some = step.dig("expect", "some")
      raise Failure, "no code #{some}" unless some.nil? || sent.any? { |id, _| got[id].code == some }
    end
    @due = {}
  end

  def close # every session that was named
    play(@tokens.keys.map { |name| { "session" => name, "request" => { "close" => {} } } }) if @workers.any?
  end
end

server = Server.new(ARGV.fetch(0) { abort("usage: client.rb ENDPOINT [CASES.json]") })
player = Player.new(server)
player.play([{ "to" => "gateway", "request" => { "hello" => {} }, "label" => "hello" }])
if ARGV[1]
  dataset = server.behind(player.labels["hello"].envelope.hello.dataset_port)
  failed = JSON.parse(File.read(ARGV[1])).reject do |entry|
    Player.new(server, dataset).tap { |one| one.play(entry["steps"]) }.close
    puts "ok     #{entry["name"]}"
    true
  rescue Failure => e
    puts "FAILED #{entry["name"]}: #{e.message}"
  end
  exit(failed.empty?)
end
numbered = ->(kind, n, *more) { { "request" => { kind => {} }, "arrays" => [["numbers", "UINT64", [1], n], *more] } }
open = { "environment" => "HalfCheetah", "num_envs" => 1 }
player.play([{ "to" => "gateway", "request" => { "open" => open } }, numbered["reset", 1]])
rewards = (2..1001).sum do |number|
  actions = ["actions", "FLOAT32", [1, 6], Array.new(6) { rand(-1.0..1.0) }]
  player.play([numbered["step", number, actions].merge("label" => "step")])
  player.labels["step"].arrays["rewards"][2].unpack1("E")
end
player.close
puts "return of 1,000 random steps: #{rewards}"
