use super::*;

fn key(seed: u8) -> SecretKey {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("key");
    std::fs::write(&file, format!("ed25519-secret {}\n", hex(&[seed; 32]))).expect("a written key");
    SecretKey::read(&file).expect("a key")
}

#[test]
fn a_signature_survives_its_file_and_holds_for_its_bytes_alone() {
    let (mine, file) = (key(7), Path::new("d.lock"));
    let signature = Signature::parse(file, &mine.sign(b"lock").to_string()).expect("reads what it wrote");
    signature::demand(file, b"lock", Some(&signature), &[key(8).public(), mine.public()]).expect("listed");
    let line = |bytes: &[u8], signature: Option<&Signature>, keys: &[PublicKey]| {
        signature::demand(file, bytes, signature, keys).expect_err("a refusal").to_string()
    };
    assert!(line(b"locked", Some(&signature), &[mine.public()]).contains("of other bytes"));
    assert!(line(b"lock", None, &[mine.public()]).contains("found nothing, wanted a signature by"));
    assert!(line(b"lock", Some(&signature), &[key(8).public()]).contains("which is not listed"));
    signature::demand(file, b"lock", None, &[]).expect("nothing is demanded");
}

#[test]
fn a_borrowed_name_does_not_make_a_signature() {
    let (mine, theirs) = (key(7), key(8));
    let forged =
        theirs.sign(b"lock").to_string().replace(&theirs.public().to_string(), &mine.public().to_string());
    let forged = Signature::parse(Path::new("d.lock.sig"), &forged).expect("well-formed");
    signature::demand(Path::new("d.lock"), b"lock", Some(&forged), &[mine.public()]).expect_err("forged");
}

#[test]
fn keys_that_are_none_are_refused() {
    // The identity, of order one: any message has a signature under it.
    let weak = format!("01{}", "00".repeat(31));
    for text in ["", "ab", &"g".repeat(64), &"AB".repeat(32), &weak] {
        text.parse::<PublicKey>().expect_err(text);
    }
    assert_eq!(key(7).public().to_string().parse(), Ok(key(7).public()));
}

#[test]
fn a_generated_key_is_a_new_one() {
    let [one, other] = [(); 2].map(|()| SecretKey::generate().expect("randomness").public());
    assert_ne!(one, other);
}
